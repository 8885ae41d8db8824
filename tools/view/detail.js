// The bytes that are selected, as a dump.

class Detail {
  constructor(element) {
    this.lines = [];
    this.head = make('div', {class: 'detail-head'});
    this.list = new VirtualList({label: 'Bytes in hex and as text', height: 20, role: 'group', render: index => this.line(index)});
    this.list.element.classList.add('dump');
    element.append(this.head, this.list.element);
    this.width = 16;
    new ResizeObserver(() => this.fit()).observe(element);
  }

  // 16 bytes in a line where there is room for them, else 8.
  fit() {
    const width = this.list.element.clientWidth < 560 ? 8 : 16;
    if (width === this.width) return;
    this.width = width;
    this.layout();
  }

  // head: elements; parts: {label, side, bytes, marks: pairs of offsets, selected: such a pair, differs: bytes that it is
  // compared with} or {label, text}.
  show(head, parts) {
    this.head.replaceChildren(...head);
    this.parts = parts;
    this.layout();
    const at = this.lines.findIndex(line => line.part.selected && line.from !== undefined && line.from + this.width > line.part.selected[0]);
    this.list.scrollTo(at > 6 ? (at - 3) * this.list.height : 0);
  }

  layout() {
    this.lines = [];
    for (const part of this.parts || []) {
      this.lines.push({part});
      if (part.text !== undefined) this.lines.push(...part.text.map(text => ({part, text})));
      else for (let from = 0; from < part.bytes.length; from += this.width) this.lines.push({part, from});
    }
    this.list.setCount(this.lines.length);
  }

  line(index) {
    const {part, from, text} = this.lines[index];
    if (text !== undefined) return make('div', {class: 'row event-text'}, text);
    if (from === undefined) return make('div', {class: `row part ${part.side === undefined ? '' : part.side === READ ? 'read' : 'write'}`}, part.label);
    return this.dumpLine(part, from);
  }

  dumpLine(part, from) {
    const to = Math.min(from + this.width, part.bytes.length);
    const hex = make('span', {class: 'hex'});
    const text = make('span', {class: 'ascii'});
    for (let i = from; i < to; ++i) {
      const look = this.lookOf(part, i);
      hex.append(make('span', {class: `byte ${look}`}, HEX[part.bytes[i]]), i % 8 === 7 && i + 1 < to ? '  ' : ' ');
      const plain = part.bytes[i] >= 32 && part.bytes[i] < 127;
      text.append(make('span', {class: plain ? look : `dot ${look}`}, plain ? String.fromCharCode(part.bytes[i]) : '·'));
    }
    hex.append(' '.repeat((this.width - (to - from)) * 3 + (to - from <= 8 && this.width === 16 ? 1 : 0)));
    return make('div', {class: 'row line'}, make('span', {class: 'offset'}, from.toString(16).padStart(4, '0')), hex, text);
  }

  lookOf(part, at) {
    if (part.marks?.some(([from, to]) => at >= from && at < to)) return 'hit';
    if (part.differs && part.differs[at] !== part.bytes[at]) return 'differs';
    return part.selected && at >= part.selected[0] && at < part.selected[1] ? 'in' : '';
  }
}

// What is shown of the selection of a pane: the elements of the head and the parts.
function detailOf(app, pane, hit) {
  const place = pane.selection;
  if (place.event !== undefined) return eventDetail(pane, pane.tape.events[place.event]);
  const exchange = pane.exchanges.of(place.block);
  const row = pane.rows.at(pane.rows.ofBlock(place.block));
  return exchange < 0 ? unaskedDetail(pane, row, hit) : exchangeDetail(app, pane, exchange, row, hit);
}

function headOf(title, facts) {
  return [make('h2', {}, title), make('p', {class: 'quiet'}, facts.filter(Boolean).join(' · '))];
}

function wallText(tape, at) {
  if (tape.zero === null) return '';
  return new Date(tape.zero + at / 1000).toISOString().replace('T', ' ').replace('Z', ' UTC');
}

function eventDetail(pane, event) {
  const facts = [`at ${secondsText(event.at)} s`, wallText(pane.tape, event.at)];
  const lines = Object.keys(event.data).length ? JSON.stringify(event.data, null, 2).split('\n') : [event.line];
  return [headOf(`Event: ${safeLine(event.kind)}`, facts), [{label: 'as it is on the tape', text: lines.map(safeLine)}]];
}

function unaskedDetail(pane, row, hit) {
  const at = pane.tape.times[row.block];
  const facts = [`at ${secondsText(at)} s`, wallText(pane.tape, at), 'nothing was asked before it since the open'];
  return [headOf('Unasked', facts), [partOf(pane, row.side, row.block, row.to, row, hit)]];
}

// Bytes of one side in the blocks from..to.
function partOf(pane, side, from, to, row, hit) {
  const sums = pane.tape.before[side];
  const bytes = pane.tape.bytes(side, from, to);
  const blocks = to - from;
  const at = pane.tape.times[from];
  const part = {side, bytes, label: `${side === READ ? '← device' : 'driver →'}  ${counted(bytes.length, 'byte')} at ${secondsText(at)} s` +
    (blocks > 1 ? `, ${counted(blocks, 'block')} in ${spanText(pane.tape.times[to - 1] - at)}` : '')};
  if (row && row.side === side) {
    const offset = block => sums[Math.max(from, Math.min(to, block))] - sums[from];
    part.selected = [offset(row.block), offset(row.to)];
    if (part.selected[0] === 0 && part.selected[1] === bytes.length) part.selected = [0, 0];
  }
  part.marks = pane.search.marks(side, sums[from], sums[to]);
  if (hit && hit.side === side) part.selected = [hit.from - sums[from], hit.to - sums[from]];
  return part;
}

function exchangeParts(pane, exchange, row, hit) {
  const {start, answer, end} = pane.exchanges;
  const asked = answer[exchange] === NONE ? end[exchange] : answer[exchange];
  const parts = [partOf(pane, WRITE, start[exchange], asked, row, hit)];
  parts.push(answer[exchange] === NONE ? {label: 'no answer', text: []} : partOf(pane, READ, asked, end[exchange], row, hit));
  return parts;
}

function exchangeDetail(app, pane, exchange, row, hit) {
  const {tape, exchanges, summary} = pane;
  const at = tape.times[exchanges.start[exchange]];
  const latency = exchanges.latency(exchange);
  const usual = summary ? ` (median ${spanText(summary.kindOf[exchange].median || summary.median)})` : '';
  const facts = [`at ${secondsText(at)} s`, wallText(tape, at), latency === null ? 'no answer' : `answered after ${spanText(latency)}${usual}`];
  const head = headOf(`Exchange ${exchange + 1}`, facts);
  const odd = summary?.odd.has(exchange) && summary.oddness(summary.kindOf[exchange], exchanges.answered(exchange));
  if (odd) head.push(make('p', {class: 'remark'}, odd));
  const parts = exchangeParts(pane, exchange, row, hit);
  const partner = app.comparison ? app.comparison.partner(pane.index, exchange) : -1;
  return [head, partner < 0 ? parts : comparedParts(app, pane, parts, partner)];
}

// Request beside request, answer beside answer, what differs set apart.
function comparedParts(app, pane, parts, partner) {
  const other = app.panes[1 - pane.index];
  const others = exchangeParts(other, partner, null, null);
  const named = (part, of) => ({...part, label: `${'AB'[of.index]}  ${part.label}`});
  return parts.flatMap((part, index) => {
    const two = [named(part, pane), named(others[index], other)];
    if (part.bytes && others[index].bytes) {
      two[0].differs = others[index].bytes;
      two[1].differs = part.bytes;
    }
    return pane.index === 0 ? two : two.reverse();
  });
}

const MOST_KIND_LINES = 200;

// A table of the kinds of requests, the most frequent first.
function requestLines(summary) {
  const kinds = [...summary.kinds].sort((a, b) => b[1].asked - a[1].asked);
  if (!kinds.length) return ['The driver has asked nothing.'];
  const row = cells => cells.map((cell, at) => at ? cell.padStart(10) : cell.slice(0, 18).padEnd(18)).join(' ');
  const lines = kinds.slice(0, MOST_KIND_LINES).map(([, {name, asked, latencies}]) => row([name, String(asked),
    String(asked - latencies.length), ...[0.5, 1].map(share => latencies.length ? spanText(latencies[Math.floor((latencies.length - 1) * share)]) : '-')]));
  if (kinds.length > MOST_KIND_LINES) lines.push(`and ${kinds.length - MOST_KIND_LINES} more kinds`);
  return [row(['begins with', 'asked', 'no answer', 'median', 'slowest']), ...lines];
}

// One tape of the page: its timeline, its list of rows, its search, and what is selected of it.

class Pane {
  // app: onSelect(pane, place, event), onPick(pane, time), comparison
  constructor(app, tape, index, range) {
    this.app = app;
    this.tape = tape;
    this.index = index;
    this.exchanges = new Exchanges(tape);
    this.search = new Search(tape);
    this.summary = null;  // comes later
    this.selection = null;  // {block, to} or {event}
    this.timeline = new Timeline({tape, exchanges: this.exchanges, range, label: `Timeline of ${tape.name}`,
      onPick: time => app.pick(this, time)});
    this.list = new VirtualList({label: `Traffic of ${tape.name}`, height: 24, render: row => this.row(row),
      onSelect: (row, event) => app.select(this, this.placeOfRow(row), event)});
    this.list.element.addEventListener('focus', () => app.activate(this));
    this.element = make('div', {class: 'pane'}, this.list.element);
  }

  setView(view) {
    this.view = view;
    this.rows = new Rows(this.tape, view.name);
    this.element.dataset.view = view.name;
    this.list.setHeight(view.height);
    this.list.setCount(this.rows.count);
    this.list.select(this.selection ? this.rowOf(this.selection) : -1);
  }

  placeOfRow(row) {
    const {block, event} = this.rows.at(row);
    return event === undefined ? {block} : {event};
  }

  rowOf(place) {
    return place.event === undefined ? this.rows.ofBlock(place.block) : this.rows.ofEvent(place.event);
  }

  timeOf(place) {
    return place.event === undefined ? this.tape.times[place.block] : this.tape.events[place.event].at;
  }

  // What is at a time: the last thing that is not later.
  placeAt(time) {
    const block = upperBound(this.tape.times, time) - 1;
    const event = upperBound(this.tape.eventTimes, time) - 1;
    if (block < 0 && event < 0) return this.tape.count ? {block: 0} : this.tape.events.length ? {event: 0} : null;
    const isEvent = event >= 0 && (block < 0 || this.tape.events[event].at > this.tape.times[block]);
    return isEvent ? {event} : {block};
  }

  // What is nearest to a time.
  nearest(time) {
    const place = this.placeAt(time);
    const after = lowerBound(this.tape.times, time);
    if (!place || after >= this.tape.count) return place;
    return Math.abs(this.tape.times[after] - time) < Math.abs(this.timeOf(place) - time) ? {block: after} : place;
  }

  select(place, reveals = true) {
    this.selection = place;
    const row = this.rowOf(place);
    this.list.select(row, reveals);
    const at = this.timeOf(place);
    const exchange = place.event === undefined ? this.exchanges.of(place.block) : -1;
    this.timeline.selected = exchange < 0 ? {at, from: at, to: at} :
      {at, from: this.tape.times[this.exchanges.start[exchange]], to: this.tape.times[this.exchanges.end[exchange] - 1]};
    this.timeline.drawSoon();
  }

  refresh() {
    this.list.clear();
    this.timeline.drawSoon();
  }

  // Rows.
  row(index) {
    const row = this.rows.at(index);
    const time = this.rows.timeOf(index);
    const before = index > 0 ? time - this.rows.timeOf(index - 1) : 0;
    const stamp = make('span', {class: 'time'}, secondsText(time));
    const element = make('div', {class: 'row'}, stamp);
    if (row.event !== undefined) this.fillEvent(element, this.tape.events[row.event]);
    else if (this.view.name === 'exchanges') this.fillArrow(element, row);
    else this.fillBytes(element, row, before);
    return element;
  }

  fillEvent(element, event) {
    const bad = ['gap', 'device-lost', 'fault'].includes(event.kind);
    element.classList.add('event');
    if (bad) element.classList.add('bad');
    if (event.kind === 'mark') element.classList.add('is-mark');
    element.append(make('span', {class: 'kind'}, safeLine(event.kind)), make('span', {class: 'event-text'}, eventText(event).slice(0, 300)));
  }

  marksOf({block, to, side}) {
    const sums = this.tape.before[side];
    return this.search.marks(side, sums[block], sums[to]);
  }

  // The first bytes of a row, as text and hex.
  preview(row, most) {
    const all = this.tape.bytes(row.side, row.block, row.to);
    const bytes = all.subarray(0, most);
    const marks = this.marksOf(row);
    const text = make('span', {class: 'text'});
    const hex = make('span', {class: 'hex'});
    appendText(text, bytes, marks);
    appendHex(hex, bytes, marks);
    if (all.length > most) hex.append('…');
    return {text, hex, size: all.length};
  }

  fillBytes(element, row, before) {
    const {text, hex, size} = this.preview(row, 96);
    element.classList.add(row.side === READ ? 'read' : 'write');
    element.append(
      make('span', {class: 'delta'}, '+' + spanText(before)),
      make('span', {class: 'way'}, row.side === READ ? '← device' : 'driver →'),
      make('span', {class: 'size'}, String(size)), text, hex);
    this.flag(element, row);
  }

  fillArrow(element, row) {
    const {text, hex, size} = this.preview(row, 200);
    const exchange = this.exchanges.of(row.block);
    element.classList.add('arrow', row.side === READ ? 'read' : 'write');
    const begins = exchange >= 0 && row.block === this.exchanges.start[exchange];
    if (begins) element.classList.add('begins');
    const unanswered = this.summary?.silent.has(row.to - 1);
    if (unanswered) element.classList.add('unanswered');
    const label = make('span', {class: 'label'}, mostlyPlain(this.tape.bytes(row.side, row.block, row.to)) ? text : hex);
    element.append(
      make('span', {class: 'number'}, begins ? `#${exchange + 1}` : ''),
      make('span', {class: 'track'}, label, make('span', {class: 'shaft'}, unanswered ? make('span', {class: 'cross'}, '✕ no answer') : null)),
      this.latencyCell(row, exchange), make('span', {class: 'size'}, sizeText(size)));
    this.flag(element, row);
  }

  // How long an answer took, with a bar as long as its logarithm.
  latencyCell(row, exchange) {
    const cell = make('span', {class: 'latency'});
    if (exchange < 0 || this.exchanges.answer[exchange] !== row.block) return cell;
    const latency = this.exchanges.latency(exchange);
    cell.append(make('span', {class: 'span'}, spanText(latency)));
    const bar = make('span', {class: 'bar', 'aria-hidden': 'true'});
    bar.style.width = `${Math.min(100, Math.max(3, Math.log10(1 + latency / 10) * 18))}%`;
    cell.append(bar);
    return cell;
  }

  // What is to be noticed of a row.
  flag(element, row) {
    const exchange = this.exchanges.of(row.block);
    if (exchange < 0) return;
    if (row.side === READ && this.summary?.slow.has(exchange)) element.classList.add('slow');
    if (row.side === READ && this.summary?.odd.has(exchange)) element.classList.add('odd');
    const kinds = this.app.comparison?.kinds(this.index, exchange) || [];
    const [look, text] = kinds.length ? [kinds[0], kinds.join(', ')] :
      element.classList.contains('odd') ? ['odd', 'odd'] : element.classList.contains('slow') ? ['slow', 'slow'] : [''];
    const cell = kinds.length ? element.querySelector('.latency') : null;
    if (cell && row.side === READ) return;
    if (look) (cell || element).append(make('span', {class: 'flag'}, make('span', {class: `badge ${look}`}, text)));
  }

  // Steps.
  step(by) {
    const row = this.selection ? this.rowOf(this.selection) : -1;
    return this.placeOfRow(Math.max(0, Math.min(this.rows.count - 1, row + by)));
  }

  stepExchange(by) {
    if (!this.exchanges.count) return null;
    const block = this.blockOf(this.selection);
    let index = upperBound(this.exchanges.start, block) - 1 + by;
    index = Math.max(0, Math.min(this.exchanges.count - 1, index));
    return {block: this.exchanges.start[index]};
  }

  // The block that a place is at or before; -1: nothing is selected.
  blockOf(place) {
    if (!place) return -1;
    return place.event === undefined ? place.block : this.tape.events[place.event].block - 1;
  }

  // The hit behind or before the one that is selected.
  stepHit(by) {
    const {hits} = this.search;
    if (!hits.length) return null;
    if (this.hit === undefined) {
      const from = Math.max(0, this.blockOf(this.selection));
      const next = hits.findIndex(hit => hit.block >= from);
      this.hit = by > 0 ? (next < 0 ? 0 : next) : (next <= 0 ? hits.length - 1 : next - 1);
    } else {
      this.hit = (this.hit + by + hits.length) % hits.length;
    }
    return hits[this.hit];
  }
}

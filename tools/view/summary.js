// What a tape says as a whole: its exchanges, and what is worth a look.

const NONE = 0xffffffff;

// Exchanges as porttape info counts them: a run of writes and the reads up to the next one; an open or a close ends it.
// start: its first write; answer: its first read, or NONE; end: the block behind its last one.
class Exchanges {
  constructor(tape) {
    const cuts = tape.events.filter(event => event.kind === 'open' || event.kind === 'close').map(event => event.block);
    const room = new Uint32Array(tape.count);
    const [start, answer, end] = [room, room.slice(), room.slice()];
    let count = 0;
    let cut = 0;
    let state = 'none';  // none, asking, answered
    const finish = at => { if (state !== 'none') end[count - 1] = at; };
    for (let i = 0; i < tape.count; ++i) {
      while (cut < cuts.length && cuts[cut] <= i) {
        finish(i);
        state = 'none';
        ++cut;
      }
      if (tape.sides[i] === WRITE) {
        if (state === 'asking') continue;
        finish(i);
        start[count] = i;
        answer[count++] = NONE;
        state = 'asking';
      } else if (state === 'asking') {
        answer[count - 1] = i;
        state = 'answered';
      }
    }
    finish(tape.count);
    this.tape = tape;
    this.count = count;
    this.start = start.slice(0, count);
    this.answer = answer.slice(0, count);
    this.end = end.slice(0, count);
  }

  // The exchange of a block, or -1: none.
  of(block) {
    const index = upperBound(this.start, block) - 1;
    return index >= 0 && block < this.end[index] ? index : -1;
  }

  // From the last write to the first read, or null.
  latency(index) {
    const answer = this.answer[index];
    return answer === NONE ? null : this.tape.times[answer] - this.tape.times[answer - 1];
  }

  asked(index) {
    const answer = this.answer[index];
    return this.tape.bytes(WRITE, this.start[index], answer === NONE ? this.end[index] : answer);
  }

  answered(index) {
    const answer = this.answer[index];
    return answer === NONE ? new Uint8Array() : this.tape.bytes(READ, answer, this.end[index]);
  }
}

function median(sorted) {
  return sorted.length ? sorted[(sorted.length - 1) >> 1] : 0;
}

// What requests have in common that are answered alike: the word they begin with, or their first bytes and their length;
// as a number. bytes[from..to)
function requestKind(bytes, from, to) {
  let word = 0;
  let letters = 0;
  for (let i = from; i < to && letters < 8 && isLetter(bytes[i]); ++i, ++letters) word = word * 64 + (bytes[i] & 63);
  if (letters > 1) return word;
  return 2 ** 52 + (to - from) * 65536 + (bytes[from] || 0) * 256 + (to > from + 1 ? bytes[from + 1] : 0);
}

// As a person is told of it.
function kindName(bytes, from, to) {
  let word = '';
  for (let i = from; i < to && word.length < 8 && isLetter(bytes[i]); ++i) word += String.fromCharCode(bytes[i]);
  return word.length > 1 ? word : `${[...bytes.subarray(from, Math.min(to, from + 2))].map(byte => HEX[byte]).join(' ')} (${to - from} B)`;
}

function isLetter(byte) {
  return (byte | 32) >= 97 && (byte | 32) <= 122;
}

// Counts values; says which one most have.
class Tally {
  constructor() {
    this.counts = new Map();
    this.total = 0;
  }

  add(value) {
    this.counts.set(value, (this.counts.get(value) || 0) + 1);
    ++this.total;
  }

  // {value, share}
  usual() {
    let best = [undefined, 0];
    for (const entry of this.counts) if (entry[1] > best[1]) best = entry;
    return {value: best[0], share: best[1] / this.total};
  }
}

// What the answers to requests of one kind have in common.
class RequestKind {
  constructor(name) {
    this.name = name;
    this.latencies = [];
    this.length = new Tally();
    this.first = new Tally();
    this.last = new Tally();
    this.asked = 0;
  }

  // An answer: bytes[from..to)
  add(latency, bytes, from, to) {
    this.latencies.push(latency);
    this.length.add(to - from);
    this.first.add(bytes[from]);
    this.last.add(bytes[to - 1]);
  }

  finish() {
    this.latencies = Float64Array.from(this.latencies).sort();
    this.median = median(this.latencies);
    for (const name of ['length', 'first', 'last']) this[name] = this[name].usual();
  }
}

// Lets the page go on, every few milliseconds.
class Breath {
  constructor() {
    this.since = performance.now();
  }

  async take() {
    if (performance.now() - this.since < 12) return;
    await new Promise(resolve => setTimeout(resolve));
    this.since = performance.now();
  }
}

// A place worth a look: {group, at, block or event, text}; groups come in this order.
const GROUPS = [
  ['odd', 'Odd answers'], ['unanswered', 'Unanswered'], ['slow', 'Unusually slow'], ['gap', 'Gaps'],
  ['lost', 'Device lost'], ['fault', 'Injected faults'], ['after', 'After a gap or a loss']];
const MOST_PLACES = 200;  // of a group
const MOST_KINDS = 1000;  // of requests; more are one

class Summary {
  constructor(tape, exchanges) {
    this.tape = tape;
    this.exchanges = exchanges;
    this.places = new Map(GROUPS.map(([group]) => [group, []]));
    this.more = new Map(GROUPS.map(([group]) => [group, 0]));
    this.slow = new Set();
    this.odd = new Set();
    this.silent = new Set();  // the last blocks of what was asked in vain, then asked again or not
    this.kinds = new Map();
    this.kindOf = new Array(exchanges.count);
  }

  // Takes a while for a large tape, without keeping the page.
  async judge() {
    const breath = new Breath();
    const all = [];
    for (let i = 0; i < this.exchanges.count; ++i) {
      this.measure(i, all);
      if (i % 1024 === 0) await breath.take();
    }
    for (const kind of this.kinds.values()) kind.finish();
    this.latencies = Float64Array.from(all).sort();
    this.median = median(this.latencies);
    this.unanswered = this.exchanges.count - all.length;
    for (let i = 0; i < this.exchanges.count; ++i) {
      this.judgeExchange(i);
      if (i % 1024 === 0) await breath.take();
    }
    this.judgeEvents();
    return this;
  }

  measure(index, all) {
    const {start, answer, end} = this.exchanges;
    const [reads, writes] = this.tape.before;
    const to = answer[index] === NONE ? end[index] : answer[index];
    const kind = this.kindFor(writes[start[index]], writes[to]);
    ++kind.asked;
    this.kindOf[index] = kind;
    if (answer[index] === NONE) return;
    const latency = this.exchanges.latency(index);
    kind.add(latency, this.tape.streams[READ], reads[to], reads[end[index]]);
    all.push(latency);
  }

  kindFor(from, to) {
    const bytes = this.tape.streams[WRITE];
    let key = requestKind(bytes, from, to);
    let kind = this.kinds.get(key);
    if (kind) return kind;
    const isFull = this.kinds.size >= MOST_KINDS;
    if (isFull) key = -1;
    kind = this.kinds.get(key) || new RequestKind(isFull ? 'others' : kindName(bytes, from, to));
    this.kinds.set(key, kind);
    return kind;
  }

  quantile(share) {
    return this.latencies[Math.min(this.latencies.length - 1, Math.floor(share * this.latencies.length))];
  }

  place(group, place) {
    const list = this.places.get(group);
    if (list.length < MOST_PLACES) list.push({group, ...place});
    else this.more.set(group, this.more.get(group) + 1);
  }

  judgeExchange(index) {
    const block = this.exchanges.start[index];
    const at = this.tape.times[block];
    const latency = this.exchanges.latency(index);
    const repeats = this.judgeRepeats(index);
    if (latency === null) this.judgeSilence(index, at, block);
    else this.judgeAnswer(index, at, block, latency, repeats);
  }

  // Whether there is, within what is asked, a wait as for an answer that did not come.
  judgeRepeats(index) {
    const {start, answer, end} = this.exchanges;
    const {times} = this.tape;
    const to = answer[index] === NONE ? end[index] : answer[index];
    const patience = Math.max(10 * this.median, 20000);
    let repeats = false;
    for (let block = start[index] + 1; block < to; ++block) {
      const wait = times[block] - times[block - 1];
      if (wait < patience || this.latencies.length < 5) continue;
      repeats = true;
      this.silent.add(block - 1);
      this.place('unanswered', {at: times[block - 1], block: block - 1, exchange: index, text: `#${index + 1} no answer for ${spanText(wait)}, then the driver wrote again`});
    }
    return repeats;
  }

  // Where most requests have no answer, having none is nothing odd.
  judgeSilence(index, at, block) {
    const kind = this.kindOf[index];
    if (kind.latencies.length * 2 < kind.asked && kind.asked > 4) return;
    const end = this.exchanges.end[index];
    this.silent.add(end - 1);
    const wait = end < this.tape.count ? `, next block after ${spanText(this.tape.times[end] - this.tape.times[end - 1])}` : '';
    this.place('unanswered', {at, block, exchange: index, text: `#${index + 1} has no answer${wait}`});
  }

  judgeAnswer(index, at, block, latency, repeats) {
    const kind = this.kindOf[index];
    const usual = kind.latencies.length >= 8 ? kind.median : this.median;
    if (this.latencies.length >= 5 && latency > 10 * usual && latency - usual > 2000) {
      this.slow.add(index);
      const times = usual > 0 ? `, ${Math.round(latency / usual)} × the median ${spanText(usual)}` : '';
      this.place('slow', {at, block, exchange: index, text: `#${index + 1} is answered after ${spanText(latency)}${times}`});
    }
    // What was asked last is what is answered.
    const odd = repeats ? '' : this.oddness(kind, this.exchanges.answered(index));
    if (!odd) return;
    this.odd.add(index);
    this.place('odd', {at, block: this.exchanges.answer[index], exchange: index, text: `#${index + 1} ${odd}`});
  }

  // What sets an answer apart from most others to such requests.
  oddness(kind, answer) {
    if (kind.latencies.length < 5) return '';
    const said = [];
    const isOdd = (usual, value) => usual.share >= 0.75 && usual.value !== value;
    if (isOdd(kind.length, answer.length)) said.push(`${counted(answer.length, 'byte')}, usually ${kind.length.value}`);
    if (isOdd(kind.first, answer[0])) said.push(`begins with ${HEX[answer[0]]}, usually ${HEX[kind.first.value]}`);
    if (isOdd(kind.last, answer[answer.length - 1])) said.push(`ends in ${HEX[answer[answer.length - 1]]}, usually ${HEX[kind.last.value]}`);
    return said.length ? 'answer: ' + said.join('; ') : '';
  }

  judgeEvents() {
    this.tape.events.forEach((event, index) => {
      const group = {gap: 'gap', 'device-lost': 'lost', fault: 'fault'}[event.kind];
      if (!group) return;
      this.place(group, {at: event.at, event: index, text: eventText(event) || event.kind});
      if (group === 'fault') return;
      const next = lowerBound(this.exchanges.start, event.block);
      if (next >= this.exchanges.count) return;
      const block = this.exchanges.start[next];
      this.place('after', {at: this.tape.times[block], block, exchange: next, text: `#${next + 1} is the first after the ${group === 'gap' ? 'gap' : 'loss'}`});
    });
  }
}

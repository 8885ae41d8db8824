// The rows of the three views: blocks joined more or less, and the events between them.

const VIEWS = [
  {name: 'exchanges', label: 'Exchanges', height: 44},
  {name: 'bursts', label: 'Bursts', height: 24},
  {name: 'blocks', label: 'Blocks', height: 24}];
// Silences that part what is of one direction, in µs; of bursts as in porttape cat.
const SILENCES = {exchanges: 50000, bursts: 500};

// A row is the number of its first block, or ~ of an event's. Rows of a view:
class Rows {
  constructor(tape, view) {
    this.tape = tape;
    this.view = view;
    const rows = new Int32Array(tape.count + tape.events.length);
    let count = 0;
    let event = 0;
    let fresh = true;
    for (let i = 0; i <= tape.count; ++i) {
      for (; event < tape.events.length && tape.events[event].block <= i; ++event) {
        rows[count++] = ~event;
        fresh = true;
      }
      if (i === tape.count) break;
      if (fresh || this.parts(i)) rows[count++] = i;
      fresh = false;
    }
    this.rows = rows.subarray(0, count);
    this.count = count;
  }

  // Whether a block begins a row, other than behind an event.
  parts(block) {
    if (this.view === 'blocks') return true;
    const {sides, times} = this.tape;
    if (sides[block] !== sides[block - 1]) return true;
    return times[block] - times[block - 1] >= SILENCES[this.view];
  }

  // {event} or {block, to, side}
  at(row) {
    const value = this.rows[row];
    if (value < 0) return {event: ~value};
    const next = row + 1 < this.count ? this.rows[row + 1] : this.tape.count;
    const to = next < 0 ? this.tape.events[~next].block : next;
    return {block: value, to, side: this.tape.sides[value]};
  }

  timeOf(row) {
    const value = this.rows[row];
    return value < 0 ? this.tape.events[~value].at : this.tape.times[value];
  }

  // The row that a block is in.
  ofBlock(block) {
    let from = 0;
    let to = this.count;
    while (from < to) {
      const middle = (from + to) >>> 1;
      const value = this.rows[middle];
      const key = value < 0 ? this.tape.events[~value].block : value;
      if (key <= block) from = middle + 1;
      else to = middle;
    }
    let row = from - 1;
    while (row > 0 && this.rows[row] < 0) --row;
    return Math.max(0, row);
  }

  ofEvent(event) {
    // Events of one place stand together, before its block.
    const block = this.tape.events[event].block;
    let row = block < this.tape.count ? this.ofBlock(block) : this.count - 1;
    if (this.rows[row] === block) --row;
    while (row > 0 && this.rows[row] !== ~event) --row;
    return row;
  }
}

// Finds bytes in the two streams of a tape, whatever blocks they came in.

const WINDOW = 1 << 20;   // bytes looked through at a time
const OVERLAP = 1 << 16;  // what a hit may reach over the end of a window
const MOST_HITS = 100000;

// What is searched for, as a regular expression over text with a character a byte. Throws an Error that says what is wrong.
function searchExpression(kind, text) {
  if (kind === 'hex') return new RegExp(hexPattern(text), 'g');
  if (kind === 'regex') return new RegExp(text, 'gm');
  const pattern = [...new TextEncoder().encode(text)].map(byte => '\\x' + HEX[byte]).join('');
  // Small letters stand for capitals too.
  return new RegExp(pattern, text === text.toLowerCase() ? 'gi' : 'g');
}

// "01 04 ?? 0c": pairs of digits, ?? for any byte.
function hexPattern(text) {
  const digits = text.replace(/0x|[\s,:]/gi, '');
  if (!/^([0-9a-f]{2}|\?\?)+$/i.test(digits)) throw new Error('hex: pairs of digits, as in 01 04 ?? 0c');
  return digits.match(/../g).map(pair => pair === '??' ? '[^]' : '\\x' + pair).join('');
}

function byteString(bytes, from, to) {
  let text = '';
  for (let at = from; at < to; at += 8192) text += String.fromCharCode.apply(null, bytes.subarray(at, Math.min(to, at + 8192)));
  return text;
}

class Search {
  constructor(tape) {
    this.tape = tape;
    this.clear();
  }

  clear() {
    this.run = (this.run || 0) + 1;
    this.hits = [];             // {side, from, to, block}, in the order of the tape
    this.ofSide = [[], []];
    this.isCut = false;
  }

  // False: another search has begun meanwhile. progress(share)
  async find(expression, progress) {
    this.clear();
    const run = this.run;
    const found = [[], []];
    for (const side of [READ, WRITE]) {
      const bytes = this.tape.streams[side];
      for (let from = 0; from < bytes.length; from += WINDOW) {
        this.findIn(side, from, expression, found[side]);
        if (from % (8 * WINDOW) !== 0 || from === 0) continue;
        progress(from / bytes.length);
        await new Promise(resolve => setTimeout(resolve));
        if (run !== this.run) return false;
      }
    }
    this.ofSide = found;
    this.hits = [...found[READ], ...found[WRITE]].sort((a, b) => a.block - b.block || a.from - b.from);
    return true;
  }

  findIn(side, from, expression, found) {
    const bytes = this.tape.streams[side];
    const to = Math.min(bytes.length, from + WINDOW);
    const text = byteString(bytes, from, Math.min(bytes.length, to + OVERLAP));
    const last = found.length ? found[found.length - 1].to : 0;
    expression.lastIndex = Math.max(0, last - from);
    for (;;) {
      const match = expression.exec(text);
      if (!match || from + match.index >= to) return;
      if (!match[0].length) {
        ++expression.lastIndex;
        continue;
      }
      if (found.length >= MOST_HITS) {
        this.isCut = true;
        return;
      }
      const begin = from + match.index;
      found.push({side, from: begin, to: begin + match[0].length, block: this.tape.blockOfByte(side, begin)});
    }
  }

  // Pairs of offsets within the bytes from..to of a side that are hits.
  marks(side, from, to) {
    const hits = this.ofSide[side];
    const marks = [];
    let low = 0;
    let high = hits.length;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (hits[middle].to <= from) low = middle + 1;
      else high = middle;
    }
    for (let i = low; i < hits.length && hits[i].from < to; ++i) marks.push([hits[i].from - from, hits[i].to - from]);
    return marks;
  }
}

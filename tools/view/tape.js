// A tape, as porttape packed it into the page (tools/view_packer.hpp): its columns.

// Base64 to bytes.
function bytesOfBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; ++i) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

async function unpacked(text) {
  const packed = new Blob([bytesOfBase64(text)]);
  const stream = packed.stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Reads LEB128 numbers below 2^53.
class VarintReader {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  next() {
    let byte = this.bytes[this.at++];
    if (byte < 128) return byte;
    let value = byte & 127;
    for (let scale = 128; ; scale *= 128) {
      byte = this.bytes[this.at++];
      value += (byte & 127) * scale;
      if (byte < 128) return value;
    }
  }

  nextSigned() {
    const value = this.next();
    return value % 2 ? -(value + 1) / 2 : value / 2;
  }

  take(size) {
    this.at += size;
    return this.bytes.subarray(this.at - size, this.at);
  }
}

const READ = 0;   // the device to the driver
const WRITE = 1;  // the driver to the device

// The first index of a sorted array whose value is over `value`.
function upperBound(values, value, from = 0, to = values.length) {
  while (from < to) {
    const middle = (from + to) >>> 1;
    if (values[middle] <= value) from = middle + 1;
    else to = middle;
  }
  return from;
}

// The first index whose value is not below `value`.
function lowerBound(values, value, from = 0, to = values.length) {
  while (from < to) {
    const middle = (from + to) >>> 1;
    if (values[middle] < value) from = middle + 1;
    else to = middle;
  }
  return from;
}

// Blocks are numbers from 0; times are microseconds. before[side][i] is how many bytes of that side come before block i.
class Tape {
  constructor(facts) {
    const count = facts.blocks;
    this.facts = facts;
    this.name = facts.name;
    this.count = count;
    this.times = new Float64Array(count);
    this.sides = new Uint8Array(count);
    this.before = [new Uint32Array(count + 1), new Uint32Array(count + 1)];
    this.streams = [new Uint8Array(facts.read), new Uint8Array(facts.written)];
    this.events = [];
    this.filled = 0;
    this.fillTime = 0;
    this.fillBytes = [0, 0];
    this.header = parsedObject(facts.header);
  }

  // A chunk of the page.
  add(chunk) {
    const head = new DataView(chunk.buffer, chunk.byteOffset, 24);
    const [blocks, events, timeSize, lengthSize, lineSize, readSize] = [0, 4, 8, 12, 16, 20].map(at => head.getUint32(at, true));
    const columns = new VarintReader(chunk);
    columns.take(24);
    this.addBlocks(blocks, columns.take(timeSize), columns.take(lengthSize));
    this.addEvents(events, columns.take(lineSize));
    this.addBytes(READ, columns.take(readSize));
    this.addBytes(WRITE, chunk.subarray(columns.at));
  }

  addBlocks(count, timeColumn, lengthColumn) {
    const times = new VarintReader(timeColumn);
    const lengths = new VarintReader(lengthColumn);
    const [reads, writes] = this.before;
    for (let i = this.filled; i < this.filled + count; ++i) {
      this.times[i] = this.fillTime += times.next();
      const length = lengths.next();
      const side = length % 2;
      this.sides[i] = side;
      reads[i + 1] = reads[i] + (side === READ ? length / 2 : 0);
      writes[i + 1] = writes[i] + (side === WRITE ? (length - 1) / 2 : 0);
    }
    this.filled += count;
  }

  addEvents(count, column) {
    const reader = new VarintReader(column);
    const decoder = new TextDecoder();
    for (let i = 0; i < count; ++i) {
      const at = reader.nextSigned();
      const block = reader.next();
      const line = decoder.decode(reader.take(reader.next()));
      const data = parsedObject(line);
      this.events.push({at, block, line, data, kind: String(data.event ?? 'event')});
    }
  }

  addBytes(side, bytes) {
    this.streams[side].set(bytes, this.fillBytes[side]);
    this.fillBytes[side] += bytes.length;
  }

  // Once all chunks are there.
  finish() {
    this.eventTimes = Float64Array.from(this.events, event => event.at);
    this.zero = this.wallOfZero();
    this.end = Math.max(1, ...[this.eventTimes, this.times].map(times => times.length ? times[times.length - 1] : 0));
  }

  length(block) {
    const sums = this.before[this.sides[block]];
    return sums[block + 1] - sums[block];
  }

  // The bytes of the blocks from `from` up to `to` that went to `side`.
  bytes(side, from, to) {
    return this.streams[side].subarray(this.before[side][from], this.before[side][to]);
  }

  // The block that holds a byte of a side's stream.
  blockOfByte(side, offset) {
    return upperBound(this.before[side], offset) - 1;
  }

  // The wall time of the tape's zero in ms, or null.
  wallOfZero() {
    const later = this.events.filter(event => event.kind === 'zero').pop();
    const zero = (later && (later.data.zero || later.data)) || this.header.zero;
    const wall = zero && typeof zero.wall === 'string' ? Date.parse(zero.wall) : NaN;
    return Number.isNaN(wall) ? null : wall;
  }
}

// An object written in JSON; empty where it is none.
function parsedObject(text) {
  try {
    const value = JSON.parse(text);
    return value && typeof value === 'object' ? value : {};
  } catch {
    return {};
  }
}

// What porttape put into the page; takes it out of the document.
async function loadTapes() {
  const take = kind => {
    const elements = [...document.querySelectorAll(`script[data-of="${kind}"]`)];
    return elements.map(element => {
      element.remove();
      return element.textContent;
    });
  };
  const facts = JSON.parse(new TextDecoder().decode(await unpacked(take('facts')[0])));
  const tapes = [];
  for (const [index, each] of facts.tapes.entries()) {
    const tape = new Tape(each);
    for (const chunk of await Promise.all(take(`tape${index + 1}`).map(unpacked))) tape.add(chunk);
    tape.finish();
    tapes.push(tape);
  }
  return {tapes, differences: facts.differences};
}

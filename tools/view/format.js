// Times, sizes and bytes as text, and small elements. Text of tapes goes into the page by textContent alone.

// An element: make('div', {class: 'row', title: '…'}, children or texts …).
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value);
  }
  element.append(...children.filter(child => child !== null));
  return element;
}

// "12.345678"
function secondsText(us) {
  return (us / 1e6).toFixed(6);
}

// "12.345": as many decimals as count.
function shortSeconds(us) {
  return secondsText(us).replace(/\.?0+$/, '');
}

function threeDigits(value) {
  return value >= 100 ? value.toFixed(0) : value >= 10 ? value.toFixed(1).replace(/\.0$/, '') : value.toFixed(2).replace(/\.?0+$/, '');
}

// "4.13 ms"
function spanText(us) {
  if (us < 0) return '−' + spanText(-us);
  if (us < 1000) return `${Math.round(us)} µs`;
  if (us < 999500) return `${threeDigits(us / 1000)} ms`;
  if (us < 120e6) return `${threeDigits(us / 1e6)} s`;
  if (us < 7200e6) return `${threeDigits(us / 60e6)} min`;
  return us < 172800e6 ? `${threeDigits(us / 3600e6)} h` : `${threeDigits(us / 86400e6)} d`;
}

function sizeText(bytes) {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 999500) return `${threeDigits(bytes / 1e3)} kB`;
  return `${threeDigits(bytes / 1e6)} MB`;
}

function counted(count, word) {
  return `${count.toLocaleString('en')} ${word}${count === 1 ? '' : 's'}`;
}

const HEX = Array.from({length: 256}, (_, byte) => byte.toString(16).padStart(2, '0'));
const SHORT_ESCAPES = {9: '\\t', 10: '\\n', 13: '\\r', 92: '\\\\'};

// Whether text says more of the bytes than hex.
function mostlyPlain(bytes) {
  const count = Math.min(bytes.length, 64);
  let plain = 0;
  for (let i = 0; i < count; ++i) if (isPlain(bytes[i]) || SHORT_ESCAPES[bytes[i]]) ++plain;
  return plain >= count * 0.8;
}

function isPlain(byte) {
  return byte >= 32 && byte < 127 && byte !== 92;
}

// A byte as it stands in text: itself, or escaped.
function byteText(byte) {
  return isPlain(byte) ? String.fromCharCode(byte) : SHORT_ESCAPES[byte] || '\\x' + HEX[byte];
}

// Text from elsewhere in one line in which nothing turns the direction of writing or is not seen.
function safeLine(text) {
  return String(text).replace(/[\u0000-\u001f\u007f-\u009f\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff]/g,
    character => '\\u' + character.charCodeAt(0).toString(16).padStart(4, '0'));
}

// Bytes as text into an element, escapes set apart; marks: pairs of offsets from and to.
function appendText(element, bytes, marks = []) {
  appendRuns(element, bytes, marks, byteText, byte => isPlain(byte) ? '' : 'escape');
}

function appendHex(element, bytes, marks = []) {
  appendRuns(element, bytes, marks, byte => HEX[byte] + ' ', () => '');
}

// Puts bytes of the same look into one node each.
function appendRuns(element, bytes, marks, textOf, lookOf) {
  const marked = new Uint8Array(bytes.length);
  for (const [from, to] of marks) marked.fill(1, Math.max(0, from), Math.max(0, to));
  let text = '';
  let look = '';
  let mark = 0;
  const flush = () => {
    if (!text) return;
    const node = look ? make('span', {class: look}, text) : document.createTextNode(text);
    element.append(mark ? make('mark', {}, node) : node);
    text = '';
  };
  for (let i = 0; i < bytes.length; ++i) {
    const next = lookOf(bytes[i]);
    if (next !== look || marked[i] !== mark) flush();
    [look, mark] = [next, marked[i]];
    text += textOf(bytes[i]);
  }
  flush();
}

// What an event says, in a line.
function eventText(event) {
  const data = event.data;
  switch (event.kind) {
    case 'mark': return safeLine(data.text ?? '');
    case 'gap': return `${counted(Number(data.bytes) || 0, 'byte')} missing: ${safeLine(data.why ?? '')}`;
    case 'device-lost': return safeLine(data.why ?? '');
  }
  const rest = Object.entries(data).filter(([key]) => key !== 't_us' && key !== 'event' && key !== 'end');
  if (!rest.length && !data.event) return safeLine(event.line);
  return rest.map(([key, value]) => safeLine(`${key} ${typeof value === 'object' ? JSON.stringify(value) : value}`)).join(', ');
}

// The timeline of a tape: a strip of the whole and, below it, the range that is looked at.

const AXIS = 20;      // pixels at the bottom of the timeline, for times
const FLAGS = 16;     // pixels at its top, for events
const FEW_EXCHANGES = 300;  // so many are drawn one by one

// Which times are seen; timelines of two tapes share one.
class TimeRange {
  constructor(end) {
    this.end = end;
    this.from = 0;
    this.to = end;
    this.listeners = [];
  }

  set(from, to) {
    const least = 20;
    const span = Math.min(Math.max(to - from, least), this.end * 1.04);
    this.from = Math.min(Math.max(from, -this.end * 0.02), this.end * 1.02 - span);
    this.to = this.from + span;
    this.listeners.forEach(listener => listener());
  }

  zoom(factor, around = (this.from + this.to) / 2) {
    this.set(around - (around - this.from) * factor, around + (this.to - around) * factor);
  }

  move(share) {
    const by = (this.to - this.from) * share;
    this.set(this.from + by, this.to + by);
  }

  whole() {
    this.set(-this.end * 0.01, this.end * 1.01);
  }

  reveal(from, to = from) {
    const span = this.to - this.from;
    if (from >= this.from + span * 0.02 && to <= this.to - span * 0.02) return;
    const middle = (from + to) / 2;
    const wide = Math.max(span, (to - from) * 1.5);
    this.set(middle - wide / 2, middle + wide / 2);
  }
}

// Colours of the style as a canvas takes them.
function canvasColors() {
  const probe = make('span');
  document.body.append(probe);
  const colors = {};
  for (const name of ['ground', 'ink', 'quiet', 'line', 'read', 'write', 'bad', 'good', 'mark', 'hit', 'raised', 'select']) {
    probe.className = `probe-${name}`;
    colors[name] = getComputedStyle(probe).color;
  }
  probe.remove();
  return colors;
}

class Timeline {
  constructor({tape, exchanges, range, label, onPick}) {
    Object.assign(this, {tape, exchanges, range, onPick});
    this.places = [];
    this.hits = [];
    this.gaps = tape.events.filter(event => event.kind === 'gap');
    this.selected = null;  // {at, from, to}
    this.strip = make('canvas', {class: 'strip', 'aria-hidden': 'true'});
    this.canvas = make('canvas', {class: 'traffic', 'aria-hidden': 'true'});
    this.slider = make('div', {class: 'slider', role: 'slider', tabindex: 0, 'aria-label': `${label}: middle of the times seen, in seconds`,
      'aria-valuemin': 0}, this.canvas);
    this.tip = make('div', {class: 'tip', 'aria-hidden': 'true', hidden: ''});
    this.element = make('div', {class: 'timeline'}, this.strip, this.slider, this.tip);
    range.listeners.push(() => this.drawSoon());
    new ResizeObserver(() => this.drawSoon()).observe(this.element);
    this.listen();
  }

  listen() {
    this.slider.addEventListener('wheel', event => {
      event.preventDefault();
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.range.move(event.deltaX / this.slider.clientWidth);
      else this.range.zoom(Math.exp(event.deltaY * 0.002), this.timeAt(event));
    }, {passive: false});
    this.drags(this.slider, (start, event) => {
      const by = (start.x - event.clientX) / this.slider.clientWidth * (start.to - start.from);
      this.range.set(start.from + by, start.to + by);
    });
    this.drags(this.strip, (start, event) => {
      const times = [start.x, event.clientX].map(x => this.stripTime(x)).sort((a, b) => a - b);
      this.range.set(times[0], times[1]);
    });
    this.slider.addEventListener('dblclick', event => this.range.zoom(0.2, this.timeAt(event)));
    this.slider.addEventListener('pointermove', event => this.showTip(event));
    this.slider.addEventListener('pointerleave', () => { this.tip.hidden = true; });
  }

  // A press that moves is a drag; one that does not is a click.
  drags(element, move) {
    let start = null;
    let moved = false;
    element.addEventListener('pointerdown', event => {
      if (event.button !== 0) return;
      start = {x: event.clientX, from: this.range.from, to: this.range.to};
      moved = false;
      element.setPointerCapture(event.pointerId);
    });
    element.addEventListener('pointermove', event => {
      if (!start) return;
      moved = moved || Math.abs(event.clientX - start.x) > 4;
      if (moved) move(start, event);
    });
    element.addEventListener('pointerup', event => {
      if (start && !moved) this.onPick(element === this.strip ? this.stripTime(event.clientX) : this.timeAt(event));
      start = null;
    });
    element.addEventListener('pointercancel', () => { start = null; });
  }

  timeAt(event) {
    const box = this.slider.getBoundingClientRect();
    return this.range.from + (event.clientX - box.left) / box.width * (this.range.to - this.range.from);
  }

  stripTime(x) {
    const box = this.strip.getBoundingClientRect();
    return (x - box.left) / box.width * this.range.end;
  }

  showTip(event) {
    const {tape} = this;
    const time = this.timeAt(event);
    const near = (this.range.to - this.range.from) / this.slider.clientWidth * 4;
    const from = lowerBound(tape.times, time - near);
    const to = upperBound(tape.times, time + near);
    const said = [`${shortSeconds(Math.round(time))} s`];
    for (const side of [WRITE, READ]) {
      const bytes = tape.before[side][to] - tape.before[side][from];
      if (bytes) said.push(`${side === READ ? 'device' : 'driver'} ${sizeText(bytes)}`);
    }
    const first = lowerBound(tape.eventTimes, time - near);
    tape.events.slice(first, Math.min(first + 3, upperBound(tape.eventTimes, time + near)))
      .forEach(each => said.push(`${each.kind} ${eventText(each)}`.slice(0, 80)));
    this.tip.textContent = said.join('  ·  ');
    this.tip.hidden = false;
    const box = this.element.getBoundingClientRect();
    const left = Math.min(event.clientX - box.left + 12, box.width - this.tip.offsetWidth - 4);
    this.tip.style.left = `${Math.max(0, left)}px`;
  }

  drawSoon() {
    if (this.waits) return;
    this.waits = true;
    requestAnimationFrame(() => {
      this.waits = false;
      this.draw();
    });
  }

  draw() {
    this.colors = Timeline.colors || (Timeline.colors = canvasColors());
    this.drawStrip();
    this.drawTraffic();
    const middle = (this.range.from + this.range.to) / 2;
    this.slider.setAttribute('aria-valuemax', (this.range.end / 1e6).toFixed(6));
    this.slider.setAttribute('aria-valuenow', Math.min(Math.max(middle, 0), this.range.end) / 1e6);
    this.slider.setAttribute('aria-valuetext', `${shortSeconds(Math.max(0, Math.round(this.range.from)))} to ${shortSeconds(Math.round(this.range.to))} s`);
  }

  // A canvas ready to be drawn to in CSS pixels.
  prepare(canvas) {
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const scale = window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
      canvas.width = Math.round(width * scale);
      canvas.height = Math.round(height * scale);
    }
    const pen = canvas.getContext('2d');
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = '11px system-ui, sans-serif';
    return {pen, width, height};
  }

  drawStrip() {
    const {pen, width, height} = this.prepare(this.strip);
    const scene = {pen, width, from: 0, to: this.range.end, top: 0, bottom: height};
    this.bars(scene, 1);
    this.placeSigns(scene, height - 1);
    const at = time => time / this.range.end * width;
    const [left, right] = [at(this.range.from), at(this.range.to)];
    pen.fillStyle = this.colors.ground;
    pen.globalAlpha = 0.65;
    pen.fillRect(0, 0, left, height);
    pen.fillRect(right, 0, width - right, height);
    pen.globalAlpha = 1;
    pen.strokeStyle = this.colors.select;
    pen.lineWidth = 1.5;
    pen.strokeRect(Math.max(0.75, left), 0.75, Math.max(3, Math.min(right, width - 1) - Math.max(0.75, left)), height - 1.5);
    this.selectionLine(scene);
  }

  drawTraffic() {
    const {pen, width, height} = this.prepare(this.canvas);
    const scene = {pen, width, from: this.range.from, to: this.range.to, top: FLAGS, bottom: height - AXIS};
    this.ticks(scene, height);
    this.drawExchanges(scene);
    this.drawSelection(scene);
    this.bars(scene, 2);
    this.drawEvents(scene);
    this.drawHits(scene);
    this.placeSigns(scene, height - AXIS - 1);
    this.selectionLine(scene);
    this.laneNames(scene);
  }

  x(scene, time) {
    return (time - scene.from) / (scene.to - scene.from) * scene.width;
  }

  // Bytes in columns, as high as their logarithm: reads above the middle, writes below.
  bars(scene, least) {
    const {pen, width} = scene;
    const {times, before, count} = this.tape;
    const middle = Math.round((scene.top + scene.bottom) / 2);
    const half = (scene.bottom - scene.top) / 2 - 2;
    const columns = Math.max(1, Math.floor(width / least));
    const step = (scene.to - scene.from) / columns;
    const sums = [new Float64Array(columns), new Float64Array(columns)];
    const most = [8, 8];
    let from = lowerBound(times, scene.from);
    for (let column = 0; column < columns && from < count; ++column) {
      const to = upperBound(times, scene.from + (column + 1) * step, from);
      for (const side of [READ, WRITE]) {
        sums[side][column] = before[side][to] - before[side][from];
        most[side] = Math.max(most[side], sums[side][column]);
      }
      from = to;
    }
    pen.fillStyle = this.colors.line;
    pen.fillRect(0, middle, width, 1);
    const scale = half / Math.log2(1 + Math.max(...most));
    for (const side of [READ, WRITE]) {
      pen.fillStyle = side === READ ? this.colors.read : this.colors.write;
      for (let column = 0; column < columns; ++column) {
        if (!sums[side][column]) continue;
        const high = Math.max(2, Math.log2(1 + sums[side][column]) * scale);
        pen.fillRect(column * least, side === READ ? middle - high : middle + 1, Math.max(1, least), high);
      }
    }
  }

  // While they are few: from the first request of each to the end of its answer.
  drawExchanges(scene) {
    const {times} = this.tape;
    const {start, answer, end} = this.exchanges;
    const first = Math.max(0, this.exchanges.of(Math.max(0, lowerBound(times, scene.from) - 1)));
    const last = upperBound(start, upperBound(times, scene.to) - 1);
    if (last - first > FEW_EXCHANGES) return;
    const {pen} = scene;
    for (let i = first; i < last; ++i) {
      const [left, right] = [this.x(scene, times[start[i]]), this.x(scene, times[end[i] - 1])];
      pen.fillStyle = this.colors.raised;
      pen.fillRect(left - 1, scene.top, Math.max(3, right - left + 3), scene.bottom - scene.top);
      if (answer[i] === NONE) continue;
      const [asked, answered] = [this.x(scene, times[answer[i] - 1]), this.x(scene, times[answer[i]])];
      const text = spanText(this.exchanges.latency(i));
      pen.fillStyle = this.colors.quiet;
      if (answered - asked > pen.measureText(text).width + 8) {
        pen.textAlign = 'center';
        pen.fillText(text, (asked + answered) / 2, (scene.top + scene.bottom) / 2 - 4);
      }
    }
  }

  drawSelection(scene) {
    if (!this.selected) return;
    const {pen} = scene;
    const [left, right] = [this.x(scene, this.selected.from), this.x(scene, this.selected.to)];
    pen.globalAlpha = 0.16;
    pen.fillStyle = this.colors.select;
    pen.fillRect(left - 3, scene.top, right - left + 7, scene.bottom - scene.top);
    pen.globalAlpha = 1;
  }

  selectionLine(scene) {
    if (!this.selected) return;
    scene.pen.fillStyle = this.colors.select;
    scene.pen.fillRect(Math.round(this.x(scene, this.selected.at)), 0, 1.5, scene.bottom);
  }

  drawEvents(scene) {
    const {pen} = scene;
    for (const gap of this.gaps) this.hatch(scene, gap);
    let free = -1;
    const {events, eventTimes} = this.tape;
    for (let i = lowerBound(eventTimes, scene.from); i < events.length && events[i].at <= scene.to; ++i) {
      const event = events[i];
      if (event.kind === 'end' || event.kind === 'zero') continue;
      const at = this.x(scene, event.at);
      if (at < free - 60) continue;
      pen.fillStyle = this.eventColor(event.kind);
      pen.fillRect(Math.round(at), 2, 1, scene.bottom - 2);
      if (at < free) continue;
      pen.textAlign = 'left';
      const text = (event.kind === 'mark' ? eventText(event) || 'mark' : event.kind).slice(0, 32);
      pen.fillText(text, at + 3, 11);
      free = at + pen.measureText(text).width + 10;
    }
  }

  eventColor(kind) {
    return this.colors[{open: 'good', mark: 'mark', gap: 'bad', 'device-lost': 'bad', fault: 'bad'}[kind] || 'quiet'];
  }

  hatch(scene, gap) {
    const to = this.x(scene, gap.at);
    const from = typeof gap.data.from_us === 'number' ? Math.min(this.x(scene, gap.data.from_us), to - 3) : to - 3;
    const {pen} = scene;
    pen.globalAlpha = 0.25;
    pen.fillStyle = this.colors.bad;
    pen.fillRect(from, scene.top, to - from, scene.bottom - scene.top);
    pen.globalAlpha = 1;
  }

  drawHits(scene) {
    const {pen} = scene;
    pen.fillStyle = this.colors.hit;
    let last = -2;
    for (const hit of this.hits) {
      const at = Math.round(this.x(scene, this.tape.times[hit.block]));
      if (at === last || at < 0 || at > scene.width) continue;
      pen.fillRect(at - 1, scene.top - 2, 3, 5);
      last = at;
    }
  }

  placeSigns(scene, y) {
    const {pen} = scene;
    pen.fillStyle = this.colors.bad;
    let last = -9;
    for (const place of this.places) {
      const at = this.x(scene, place.at);
      if (Math.abs(at - last) < 2 || at < 0 || at > scene.width) continue;
      pen.beginPath();
      pen.moveTo(at - 4, y);
      pen.lineTo(at + 4, y);
      pen.lineTo(at, y - 7);
      pen.fill();
      last = at;
    }
  }

  ticks(scene, height) {
    const {pen, width} = scene;
    const rough = (scene.to - scene.from) / Math.max(2, width / 110);
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = Math.max(1, power * [1, 2, 5, 10].find(factor => factor * power >= rough));
    const decimals = Math.max(0, Math.min(6, 6 - Math.floor(Math.log10(step) + 1e-9)));
    pen.textAlign = 'center';
    for (let time = Math.ceil(scene.from / step) * step; time <= scene.to; time += step) {
      const at = Math.round(this.x(scene, time));
      pen.fillStyle = this.colors.line;
      pen.fillRect(at, scene.top, 1, scene.bottom - scene.top + 3);
      pen.fillStyle = this.colors.quiet;
      const text = `${(time / 1e6).toFixed(decimals)} s`;
      if (at + pen.measureText(text).width / 2 <= width) pen.fillText(text, at, height - 5);
    }
  }

  laneNames(scene) {
    const {pen} = scene;
    const middle = (scene.top + scene.bottom) / 2;
    pen.textAlign = 'left';
    pen.font = '600 11px system-ui, sans-serif';
    for (const [text, color, y] of [['← device', 'read', middle - 12], ['driver →', 'write', middle + 20]]) {
      pen.fillStyle = this.colors.ground;
      pen.globalAlpha = 0.8;
      pen.fillRect(2, y - 11, pen.measureText(text).width + 8, 15);
      pen.globalAlpha = 1;
      pen.fillStyle = this.colors[color];
      pen.fillText(text, 6, y);
    }
  }
}

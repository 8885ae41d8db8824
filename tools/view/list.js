// A list of any length of which only what is seen is in the page. A browser's elements end at some 16 million pixels: a
// longer list scrolls in proportion, its wheel exactly.

const MOST_PIXELS = 12e6;

class VirtualList {
  // render(index) gives the element of a row; onSelect(index, event) is told of clicks and keys.
  constructor({label, height, render, onSelect, role = 'listbox'}) {
    this.render = render;
    this.onSelect = onSelect;
    this.role = role;
    this.count = 0;
    this.top = 0;  // pixels of the list that are above what is seen
    this.selected = -1;
    this.shown = new Map();
    this.id = `list${++VirtualList.made}`;
    this.space = make('div', {class: 'space', role: 'presentation'});
    this.rows = make('div', {class: 'rows', role: 'presentation'});
    this.space.append(this.rows);
    this.element = make('div', {class: 'list', tabindex: 0, role, 'aria-label': label}, this.space);
    this.element.addEventListener('scroll', () => this.scrolled(), {passive: true});
    this.element.addEventListener('wheel', event => this.wheel(event), {passive: false});
    this.element.addEventListener('click', event => this.clicked(event));
    this.element.addEventListener('keydown', event => this.key(event));
    this.resizes = new ResizeObserver(() => this.draw());
    this.resizes.observe(this.element);
    this.setHeight(height);
  }

  setHeight(height) {
    this.height = height;
    this.element.style.setProperty('--row', `${height}px`);
  }

  setCount(count) {
    this.count = count;
    this.full = count * this.height;
    this.pixels = Math.min(this.full, MOST_PIXELS);
    this.space.style.height = `${this.pixels}px`;
    this.clear();
    this.scrollTo(Math.min(this.top, this.full));
  }

  clear() {
    this.shown.forEach(row => row.remove());
    this.shown.clear();
    this.draw();
  }

  get seen() {
    return this.element.clientHeight;
  }

  get isScaled() {
    return this.full > this.pixels;
  }

  // Where the browser's scroll position stands for the list's.
  toBrowser(top) {
    return this.isScaled ? top * (this.pixels - this.seen) / (this.full - this.seen) : top;
  }

  scrolled() {
    const at = this.element.scrollTop;
    if (Math.abs(at - this.expected) > 1.5) {
      this.top = this.isScaled ? at * (this.full - this.seen) / (this.pixels - this.seen) : at;
    }
    this.expected = at;
    this.drawSoon();
  }

  wheel(event) {
    if (!this.isScaled || event.ctrlKey) return;
    event.preventDefault();
    const unit = event.deltaMode === 1 ? this.height : event.deltaMode === 2 ? this.seen : 1;
    this.scrollTo(this.top + event.deltaY * unit);
  }

  scrollTo(top) {
    this.top = Math.max(0, Math.min(top, this.full - this.seen));
    this.expected = this.toBrowser(this.top);
    this.element.scrollTop = this.expected;
    this.expected = this.element.scrollTop;
    this.drawSoon();
  }

  reveal(index) {
    const at = index * this.height;
    const margin = Math.min(3 * this.height, this.seen / 4);
    if (at < this.top + margin || at + this.height > this.top + this.seen - margin) this.scrollTo(at - this.seen / 3);
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
    const from = Math.max(0, Math.floor(this.top / this.height) - 4);
    const to = Math.min(this.count, Math.ceil((this.top + this.seen) / this.height) + 4);
    for (const [index, row] of this.shown) {
      if (index >= from && index < to) continue;
      row.remove();
      this.shown.delete(index);
    }
    const base = (this.expected || 0) - this.top;
    this.rows.style.transform = `translateY(${base + from * this.height}px)`;
    let before = null;
    for (let index = from; index < to; ++index) {
      let row = this.shown.get(index);
      if (!row) {
        row = this.made(index);
        if (before) before.after(row);
        else this.rows.prepend(row);
      }
      before = row;
    }
    this.markActive();
  }

  made(index) {
    const row = this.render(index);
    row.id = `${this.id}-${index}`;
    row.dataset.index = index;
    if (this.role === 'listbox') {
      row.setAttribute('role', 'option');
      row.setAttribute('aria-setsize', this.count);
      row.setAttribute('aria-posinset', index + 1);
      row.setAttribute('aria-selected', index === this.selected);
    }
    row.classList.toggle('selected', index === this.selected);
    this.shown.set(index, row);
    return row;
  }

  markActive() {
    if (this.shown.has(this.selected)) this.element.setAttribute('aria-activedescendant', `${this.id}-${this.selected}`);
    else this.element.removeAttribute('aria-activedescendant');
  }

  // Without telling onSelect.
  select(index, reveals = true) {
    const mark = (at, on) => {
      const row = this.shown.get(at);
      if (!row) return;
      row.classList.toggle('selected', on);
      if (this.role === 'listbox') row.setAttribute('aria-selected', on);
    };
    mark(this.selected, false);
    this.selected = index;
    mark(index, true);
    if (reveals && index >= 0) this.reveal(index);
    this.markActive();
  }

  choose(index, event) {
    const to = Math.max(0, Math.min(index, this.count - 1));
    if (this.count) this.onSelect?.(to, event);
  }

  clicked(event) {
    const row = event.target.closest('[data-index]');
    if (row && this.rows.contains(row)) this.choose(Number(row.dataset.index), event);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const page = Math.max(1, Math.floor(this.seen / this.height) - 1);
    const to = {
      ArrowDown: this.selected + 1, ArrowUp: this.selected - 1, j: this.selected + 1, k: this.selected - 1,
      PageDown: this.selected + page, PageUp: this.selected - page, Home: 0, End: this.count - 1}[event.key];
    if (to === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    if (this.role === 'listbox') this.choose(to, event);
    else this.scrollTo({Home: 0, End: this.full, PageDown: this.top + this.seen, PageUp: this.top - this.seen}[event.key] ??
      this.top + (to > this.selected ? 1 : -1) * this.height);
  }
}
VirtualList.made = 0;

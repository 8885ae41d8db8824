// The page: what is selected, what its parts show of it, its keys and its address.

const $ = id => document.getElementById(id);

class App {
  constructor({tapes, differences}) {
    this.range = new TimeRange(Math.max(...tapes.map(tape => tape.end)));
    this.panes = tapes.map((tape, index) => new Pane(this, tape, index, this.range));
    this.active = this.panes[0];
    this.comparison = differences ? new Comparison(differences, this.panes.map(pane => pane.exchanges)) : null;
    this.detail = new Detail($('detail'));
    this.side = new Side(this);
    this.build();
    this.setView('exchanges');
    this.range.whole();
    this.openAddress();
    if (!this.active.selection) this.showWelcome();
  }

  build() {
    document.body.classList.toggle('two', this.panes.length === 2);
    this.panes.forEach(pane => {
      if (this.panes.length === 2) {
        const letter = 'AB'[pane.index];
        pane.element.prepend(make('h2', {class: 'pane-name'}, make('span', {class: `letter ${letter}`}, letter), ' ', pane.tape.name));
        pane.timeline.element.prepend(make('span', {class: `letter ${letter}`}, letter));
      }
      $('timelines').append(pane.timeline.element);
      $('panes').append(pane.element);
    });
    document.title = this.panes.map(pane => pane.tape.name).join(' and ') + ' – porttape view';
    $('title').textContent = this.panes.map(pane => pane.tape.name).join('  ·  ');
    this.buildViews();
    this.showFacts();
    this.showAlerts();
    this.listen();
  }

  buildViews() {
    VIEWS.forEach((view, index) => $('views').append(make('button', {type: 'button', role: 'radio', 'data-view': view.name,
      title: `Key ${index + 1}`, onclick: () => this.setView(view.name), onkeydown: event => this.viewKey(event, index)}, view.label)));
  }

  viewKey(event, index) {
    const by = {ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1}[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    const next = (index + by + VIEWS.length) % VIEWS.length;
    this.setView(VIEWS[next].name);
    $('views').children[next].focus();
  }

  setView(name) {
    const view = VIEWS.find(each => each.name === name);
    for (const button of $('views').children) {
      const on = button.dataset.view === name;
      button.setAttribute('aria-checked', on);
      button.tabIndex = on ? 0 : -1;
    }
    this.panes.forEach(pane => pane.setView(view));
  }

  showFacts() {
    const said = [];
    for (const {tape, exchanges, summary} of this.panes) {
      const facts = [spanText(tape.end), counted(tape.count, 'block'),
        `${sizeText(tape.facts.written)} driver → device`, `${sizeText(tape.facts.read)} device → driver`,
        counted(exchanges.count, 'exchange')];
      if (summary && summary.latencies.length) facts.push(`answers: median ${spanText(summary.median)}, p99 ${spanText(summary.quantile(0.99))}`);
      if (summary && summary.unanswered) facts.push(`${summary.unanswered.toLocaleString('en')} unanswered`);
      if (tape.zero !== null) facts.push(`from ${new Date(tape.zero).toISOString().replace('T', ' ').replace('Z', ' UTC')}`);
      said.push(make('span', {class: 'tape-facts'}, facts.join(' · ')));
    }
    $('facts').replaceChildren(...said);
  }

  showAlerts() {
    const alerts = [];
    for (const {tape} of this.panes) {
      if (tape.facts.damage) alerts.push(['alert', `${tape.name} is damaged, what is sound before that is shown: ${tape.facts.damage}`]);
      if (tape.facts.torn) alerts.push(['note', `${tape.name}: ${tape.facts.torn}`]);
    }
    if (this.panes.length === 2 && !this.comparison) alerts.push(['note', 'The tapes are not compared, as one is damaged.']);
    $('alerts').hidden = !alerts.length;
    $('alerts').replaceChildren(...alerts.map(([look, text]) => make('p', {class: look}, safeLine(text))));
  }

  // Judging a large tape takes longer than showing it.
  async showSummary() {
    for (const pane of this.panes) {
      const summary = await new Summary(pane.tape, pane.exchanges).judge();
      pane.summary = summary;
      pane.timeline.places = GROUPS.filter(([group]) => group !== 'after').flatMap(([group]) => summary.places.get(group));
      pane.refresh();
    }
    this.showFacts();
    this.side.build();
    if (this.active.selection) this.showDetail();
    else this.showWelcome();
    document.body.dataset.ready = 'judged';
  }

  // Selecting.
  activate(pane) {
    this.active = pane;
    this.panes.forEach(each => each.element.classList.toggle('active', each === pane));
  }

  pick(pane, time) {
    const place = pane.nearest(time);
    if (place) this.select(pane, place);
  }

  // how: follows (the other tape is not moved), keeps (the address is not changed).
  select(pane, place, how = {}) {
    this.activate(pane);
    pane.select(place);
    const span = pane.timeline.selected;
    this.range.reveal(span.from, span.to);
    if (!how.follows) this.selectPartner(pane, place);
    this.showDetail(how.hit);
    if (!how.keeps) this.writeAddress(how instanceof KeyboardEvent);
  }

  selectPartner(pane, place) {
    if (!this.comparison) return;
    const other = this.panes[1 - pane.index];
    const exchange = place.event === undefined ? pane.exchanges.of(place.block) : -1;
    const partner = this.comparison.partner(pane.index, exchange);
    if (partner < 0) {
      const near = this.comparison.partnerBefore(pane.index, exchange);
      if (near >= 0) other.list.reveal(other.rowOf({block: other.exchanges.start[near]}));
      return;
    }
    const answers = pane.exchanges.answer[exchange] !== NONE && place.block >= pane.exchanges.answer[exchange];
    const answer = other.exchanges.answer[partner];
    other.select({block: answers && answer !== NONE ? answer : other.exchanges.start[partner]});
  }

  showDifference(difference) {
    const places = [difference.one, difference.other].map((turn, index) => turn && this.placeOfTurn(this.panes[index], turn));
    const index = places[1] ? 1 : 0;
    const isBoth = places[0] && places[1];
    if (isBoth) this.panes[1 - index].select(places[1 - index]);
    if (places[index]) this.select(this.panes[index], places[index], {follows: isBoth});
  }

  placeOfTurn(pane, turn) {
    if (turn.event) {
      const event = pane.tape.events.findIndex(each => each.at === turn.t);
      return event < 0 ? pane.placeAt(turn.t) : {event};
    }
    const block = lowerBound(pane.tape.times, turn.t);
    return block < pane.tape.count ? {block} : pane.placeAt(turn.t);
  }

  // Before anything is selected.
  showWelcome() {
    this.detail.show(headOf('Nothing is selected', ['Click a row, a place at the left or the timeline; ? tells the keys.']),
      this.panes.filter(pane => pane.summary).map(pane => ({label: `Requests of ${pane.tape.name}`, text: requestLines(pane.summary)})));
  }

  showDetail(hit) {
    const pane = this.active;
    if (!pane.selection) return;
    const [head, parts] = detailOf(this, pane, hit);
    this.detail.show(head, parts);
  }

  // The address: #t=SECONDS, &tape=2, &event=N for one of several things at a time.
  writeAddress(isStep) {
    const pane = this.active;
    const place = pane.selection;
    const hash = `#t=${shortSeconds(pane.timeOf(place))}` + (pane.index ? '&tape=2' : '') + (place.event === undefined ? '' : `&event=${place.event}`);
    if (hash === location.hash) return;
    // Steps of one walk along the rows are one entry of the history.
    const now = performance.now();
    const replaces = isStep && this.stepped && now - this.stepped < 1500;
    this.stepped = isStep ? now : 0;
    if (replaces) history.replaceState(null, '', hash);
    else history.pushState(null, '', hash);
  }

  openAddress() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    if (!wanted.has('t')) return;
    const time = Number(wanted.get('t')) * 1e6;
    if (Number.isNaN(time)) return;
    const pane = this.panes[wanted.get('tape') === '2' ? 1 : 0] || this.panes[0];
    const event = Number(wanted.get('event') ?? NaN);
    const place = pane.tape.events[event] ? {event} : pane.placeAt(Math.round(time));
    if (place) this.select(pane, place, {keeps: true});
  }

  // Searching.
  get query() {
    return $('search-kind').value + $('search-text').value;
  }

  async search() {
    const text = $('search-text').value;
    const state = $('search-state');
    $('search-text').setAttribute('aria-invalid', 'false');
    this.panes.forEach(pane => {
      pane.search.clear();
      pane.hit = undefined;
    });
    this.searched = '';
    state.textContent = '';
    if (text) {
      try {
        const expression = searchExpression($('search-kind').value, text);
        for (const pane of this.panes) {
          if (!await pane.search.find(expression, share => { state.textContent = `${Math.round(share * 100)} %`; })) return;
        }
        this.searched = this.query;
      } catch (error) {
        $('search-text').setAttribute('aria-invalid', 'true');
        state.textContent = safeLine(error.message).slice(0, 120);
      }
    }
    this.panes.forEach(pane => {
      pane.timeline.hits = pane.search.hits;
      pane.refresh();
    });
    if (this.searched) this.showSearchState();
  }

  showSearchState() {
    const {search, hit} = this.active;
    const count = search.hits.length.toLocaleString('en') + (search.isCut ? '+' : '');
    $('search-state').textContent = !search.hits.length ? 'no hit' : hit === undefined ? counted(search.hits.length, 'hit') : `${(hit + 1).toLocaleString('en')} of ${count}`;
  }

  async stepHit(by) {
    if (!$('search-text').value) return;
    if (this.searched !== this.query) await this.search();
    const hit = this.active.stepHit(by);
    this.showSearchState();
    if (hit) this.select(this.active, {block: hit.block}, {hit});
  }

  // Colours.
  nextTheme() {
    const themes = ['', 'light', 'dark'];
    const next = themes[(themes.indexOf(document.documentElement.dataset.theme || '') + 1) % themes.length];
    if (next) document.documentElement.dataset.theme = next;
    else delete document.documentElement.dataset.theme;
    $('theme').textContent = {'': '◐', light: '☀', dark: '☾'}[next];
    $('theme').setAttribute('aria-label', `Colours: ${next || 'as the system'}`);
    this.recolor();
  }

  recolor() {
    Timeline.colors = null;
    this.panes.forEach(pane => pane.timeline.drawSoon());
  }

  // Events of the browser.
  listen() {
    $('theme').addEventListener('click', () => this.nextTheme());
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.recolor());
    $('help-button').addEventListener('click', () => $('help').showModal());
    $('search').addEventListener('submit', event => {
      event.preventDefault();
      this.stepHit(1);
    });
    $('search-back').addEventListener('click', () => this.stepHit(-1));
    $('search-text').addEventListener('keydown', event => {
      if (event.key !== 'Enter' || !event.shiftKey) return;
      event.preventDefault();
      this.stepHit(-1);
    });
    let typed;
    const changed = () => {
      clearTimeout(typed);
      typed = setTimeout(() => { if (this.searched !== this.query) this.search(); }, 200);
    };
    $('search-text').addEventListener('input', changed);
    $('search-kind').addEventListener('change', changed);
    $('goto').addEventListener('submit', event => {
      event.preventDefault();
      const time = parseFloat($('goto-time').value);
      if (!Number.isNaN(time)) this.pick(this.active, time * 1e6);
    });
    window.addEventListener('popstate', () => this.openAddress());
    document.addEventListener('keydown', event => this.key(event));
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || $('help').open) return;
    if (event.target.matches('input, select')) {
      if (event.key === 'Escape') this.active.list.element.focus();
      return;
    }
    const action = this.actions()[event.key];
    if (!action) return;
    event.preventDefault();
    action(event);
  }

  actions() {
    const go = (place, event) => { if (place) this.select(this.active, place, event); };
    const list = event => this.active.list.key(event);
    return {
      '?': () => $('help').showModal(), '/': () => $('search-text').focus(), g: () => $('goto-time').focus(),
      n: () => this.stepHit(1), N: () => this.stepHit(-1),
      j: list, k: list, ArrowDown: list, ArrowUp: list, PageDown: list, PageUp: list, Home: list, End: list,
      ']': event => go(this.active.stepExchange(1), event), '[': event => go(this.active.stepExchange(-1), event),
      '.': () => this.side.step(1), ',': () => this.side.step(-1),
      '+': () => this.range.zoom(0.5), '=': () => this.range.zoom(0.5), '-': () => this.range.zoom(2), 0: () => this.range.whole(),
      z: () => this.zoomToSelection(), ArrowLeft: () => this.range.move(-0.15), ArrowRight: () => this.range.move(0.15),
      1: () => this.setView('exchanges'), 2: () => this.setView('bursts'), 3: () => this.setView('blocks'),
      x: () => this.otherPane(), d: () => this.nextTheme()};
  }

  zoomToSelection() {
    const span = this.active.timeline.selected;
    if (!span) return;
    const wide = Math.max((span.to - span.from) * 3, 1000);
    this.range.set((span.from + span.to - wide) / 2, (span.from + span.to + wide) / 2);
  }

  otherPane() {
    const pane = this.panes[1 - this.active.index] || this.active;
    this.activate(pane);
    pane.list.element.focus();
    this.showDetail();
    if (this.searched) this.showSearchState();
  }
}

loadTapes().then(data => {
  const app = window.porttape = new App(data);
  document.body.dataset.ready = 'shown';
  // Once it has been painted.
  requestAnimationFrame(() => setTimeout(() => app.showSummary()));
}).catch(error => {
  $('facts').textContent = `This page cannot be shown: ${safeLine(error.message)}`;
});

// The list at the left: what is worth a look, differences, events.

class Side {
  constructor(app) {
    this.app = app;
    this.tabs = [];
    this.tab = null;
    this.list = new VirtualList({label: 'Places', height: 66, render: index => this.row(index), onSelect: index => this.choose(index)});
    this.empty = make('p', {class: 'empty'});
    $('side-panel').append(this.empty, this.list.element);
    this.empty.textContent = 'Looking …';
  }

  // When the tapes have been judged.
  build() {
    this.tabs = [{name: 'look', label: 'Worth a look', items: this.placesWorthALook(), none: 'Nothing stands out: every exchange is answered, in its usual time and form.'}];
    const {comparison} = this.app;
    if (comparison) this.tabs.unshift({name: 'differences', label: 'Differences', items: this.differences(comparison.differences),
      none: `The tapes are the same. ${comparison.differences.agreement}.`});
    this.tabs.push({name: 'events', label: 'Events', items: this.events(), none: 'The tape has no events.'});
    $('side-tabs').replaceChildren(...this.tabs.map((tab, index) => make('button', {type: 'button', role: 'tab', id: `tab-${tab.name}`,
      'aria-controls': 'side-panel', onclick: () => this.open(index), onkeydown: event => this.tabKey(event, index)},
    tab.label + ' ', make('span', {class: 'count'}, tab.items.length.toLocaleString('en') + (tab.more ? '+' : '')))));
    this.open(0);
  }

  tabKey(event, index) {
    const by = {ArrowRight: 1, ArrowLeft: -1}[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    const next = (index + by + this.tabs.length) % this.tabs.length;
    this.open(next);
    $('side-tabs').children[next].focus();
  }

  open(index) {
    this.tab = this.tabs[index];
    [...$('side-tabs').children].forEach((button, at) => {
      button.setAttribute('aria-selected', at === index);
      button.tabIndex = at === index ? 0 : -1;
    });
    $('side-panel').setAttribute('aria-labelledby', `tab-${this.tab.name}`);
    this.list.element.setAttribute('aria-label', this.tab.label);
    this.empty.textContent = this.tab.none;
    this.empty.hidden = this.tab.items.length > 0;
    this.list.element.hidden = !this.tab.items.length;
    this.list.selected = -1;
    this.list.setCount(this.tab.items.length);
    this.list.scrollTo(0);
  }

  // Items: {at, tag, look, text, pane, go}
  placesWorthALook() {
    const items = [];
    for (const [group, title] of GROUPS) {
      for (const pane of this.app.panes) {
        for (const place of pane.summary.places.get(group)) {
          items.push({at: place.at, tag: title, look: group, text: place.text, pane,
            go: () => this.app.select(pane, place.event === undefined ? {block: place.block} : {event: place.event})});
        }
        const more = pane.summary.more.get(group);
        if (more) items.push({tag: title, look: group, text: `and ${more.toLocaleString('en')} more of them, not listed`, pane, go: () => {}});
      }
    }
    return items;
  }

  differences(differences) {
    const items = differences.list.map(difference => ({at: (difference.other || difference.one).t, tag: difference.kind, look: difference.kind,
      text: difference.text, go: () => this.app.showDifference(difference)}));
    if (differences.more) items.push({tag: 'more', look: 'more', text: `and ${differences.more.toLocaleString('en')} more, not listed; porttape diff --all tells them`, go: () => {}});
    return items;
  }

  events() {
    return this.app.panes.flatMap(pane => pane.tape.events.map((event, index) => ({at: event.at, tag: safeLine(event.kind).slice(0, 40),
      look: {gap: 'gap', 'device-lost': 'lost', fault: 'fault', mark: 'mark'}[event.kind] || 'plain', text: eventText(event).slice(0, 200), pane,
      go: () => this.app.select(pane, {event: index})})));
  }

  row(index) {
    const item = this.tab.items[index];
    const head = make('span', {class: 'item-head'}, make('span', {class: `badge ${item.look}`}, item.tag));
    if (item.pane && this.app.panes.length === 2) head.append(make('span', {class: `letter ${'AB'[item.pane.index]}`}, 'AB'[item.pane.index]));
    if (item.at !== undefined) head.append(make('span', {class: 'item-time'}, `${secondsText(item.at)} s`));
    return make('div', {class: 'row item', title: item.text}, head, make('span', {class: 'item-text'}, item.text));
  }

  choose(index) {
    this.list.select(index);
    this.tab.items[index].go();
  }

  step(by) {
    if (!this.tab?.items.length) return;
    this.choose(Math.max(0, Math.min(this.tab.items.length - 1, this.list.selected + by)));
  }
}

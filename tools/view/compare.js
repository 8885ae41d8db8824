// Two tapes side by side: which exchanges belong together, by what porttape diff tells.

class Comparison {
  constructor(differences, exchanges) {
    this.differences = differences;
    this.exchanges = exchanges;
    // Of each tape: the exchange of the other that belongs to one, or -1; the differences of one.
    this.pairs = exchanges.map(each => new Int32Array(each.count).fill(-1));
    this.ofExchange = exchanges.map(() => new Map());
    const alone = [new Set(), new Set()];
    const anchors = [];
    differences.list.forEach((difference, index) => this.take(difference, index, alone, anchors));
    anchors.sort((a, b) => a[0] - b[0]);
    this.join(alone, anchors);
  }

  // Exchanges are counted from 1.
  take(difference, index, alone, anchors) {
    const turns = [difference.one, difference.other];
    turns.forEach((turn, tape) => {
      if (turn && !turn.event && turn.exchange) {
        const list = this.ofExchange[tape].get(turn.exchange - 1);
        if (list) list.push(index);
        else this.ofExchange[tape].set(turn.exchange - 1, [index]);
      }
    });
    if (turns.some(turn => turn && (turn.event || turn.part || !turn.exchange))) return;
    const [one, other] = turns;
    if (!one) alone[1].add(other.exchange - 1);
    else if (!other) alone[0].add(one.exchange - 1);
    else if (difference.kind !== 'moved') anchors.push([one.exchange - 1, other.exchange - 1]);
    else {
      alone[0].add(one.exchange - 1);
      alone[1].add(other.exchange - 1);
    }
  }

  join(alone, anchors) {
    let at = [0, 0];
    for (const anchor of [...anchors, this.exchanges.map(each => each.count)]) {
      if (anchor[0] < at[0] || anchor[1] < at[1]) continue;
      while (at[0] < anchor[0] || at[1] < anchor[1]) {
        if (at[0] < anchor[0] && alone[0].has(at[0])) ++at[0];
        else if (at[1] < anchor[1] && alone[1].has(at[1])) ++at[1];
        else if (at[0] < anchor[0] && at[1] < anchor[1]) this.pair(at[0]++, at[1]++);
        else at = [...anchor];
      }
      if (anchor[0] < this.exchanges[0].count && anchor[1] < this.exchanges[1].count) this.pair(anchor[0], anchor[1]);
      at = [anchor[0] + 1, anchor[1] + 1];
    }
  }

  pair(one, other) {
    this.pairs[0][one] = other;
    this.pairs[1][other] = one;
  }

  // The exchange of the other tape, or -1.
  partner(tape, exchange) {
    return exchange < 0 ? -1 : this.pairs[tape][exchange];
  }

  // That of the last exchange before it that has one, or -1.
  partnerBefore(tape, exchange) {
    for (let at = exchange - 1; at >= 0; --at) if (this.pairs[tape][at] >= 0) return this.pairs[tape][at];
    return -1;
  }

  // The kinds of difference of an exchange.
  kinds(tape, exchange) {
    const list = this.ofExchange[tape].get(exchange) || [];
    return [...new Set(list.map(index => this.differences.list[index].kind))];
  }
}

// Which press becomes an answer. A press counts only for the decision that was on screen when it was pressed, and
// once; a press while nothing is asked is dropped; a held key counts once and never runs into the next decision.

const REPEAT_MS = 150; // the same input again sooner than a finger means it twice

export class Gate {
  constructor() {
    this.shown = null;
    this.answered = null;
    this.lastInput = "";
    this.lastAt = -Infinity;
  }

  /** `decision`: a name of the decision on screen that asks for an answer; null when none does. */
  show(decision) {
    this.shown = decision;
  }

  answer(decision) {
    this.answered = decision;
  }

  reopen(decision) {
    if (this.answered === decision) this.answered = null;
  }

  get open() {
    return this.shown !== null && this.shown !== this.answered;
  }

  /** Judge one press: "counts", "held", "already" or "closed". */
  press(input, at, repeats) {
    const again = input === this.lastInput && at - this.lastAt <= REPEAT_MS;
    this.lastInput = input;
    this.lastAt = at;
    if (repeats || again) return "held";
    if (this.shown === null) return "closed";
    if (this.shown === this.answered) return "already";
    this.answered = this.shown;
    return "counts";
  }
}

// What can be said, by button and by key: a way to go, praise or blame, or nothing.

import { STEPS } from "./board.js";
import { el } from "./dom.js";

const WAYS = [
  ["UP", "↑", "Up"],
  ["LEFT", "←", "Left"],
  ["RIGHT", "→", "Right"],
  ["DOWN", "↓", "Down"],
];
const LABEL_KEYS = {
  ArrowLeft: "LEFT", h: "LEFT", a: "LEFT", ArrowDown: "DOWN", j: "DOWN", s: "DOWN",
  ArrowUp: "UP", k: "UP", w: "UP", ArrowRight: "RIGHT", l: "RIGHT", d: "RIGHT",
};
const REWARD_KEYS = { "+": 1, "=": 1, p: 1, "-": -1, b: -1 };

/** The keys, for people to read. */
export const KEYS = [
  ["arrows, h j k l, w a s d", "the way you would go"],
  ["+  p", "praise"],
  ["-  b", "blame"],
  ["space", "nothing to say"],
];

export const lowered = (action) => action.charAt(0) + action.slice(1).toLowerCase();
export const way = (action) => ({ label: lowered(action), kind: "label", action });
const nothing = { label: "Nothing to say", kind: "abstain" };
const judgement = (reward) => ({ label: reward > 0 ? "Good move" : "Bad move", kind: "reward", reward });

/** What a key says where this is asked; null for a key that says nothing. */
export function saidByKey(key, asked) {
  if (key === " ") return nothing;
  if (asked === "label" && key in LABEL_KEYS) return way(LABEL_KEYS[key]);
  if (asked === "reward" && key in REWARD_KEYS) return judgement(REWARD_KEYS[key]);
  return null;
}

const inputOf = (said) => said.action ?? (said.reward ? (said.reward > 0 ? "good" : "bad") : "skip");

export class Pad {
  /** press(input, said, event) is called for every button pressed. */
  constructor(press) {
    this.press = press;
    this.kind = "";
    this.root = el("div", { class: "pad", role: "group", "aria-labelledby": "asks" });
  }

  show(decision) {
    const kind = `${decision.asked} ${decision.actions.join(" ")}`;
    if (this.kind === kind) return;
    this.kind = kind;
    this.root.dataset.kind = decision.asked;
    this.root.replaceChildren(...this.buttons(decision));
  }

  buttons({ asked, actions }) {
    const skip = this.button(nothing, { class: "skip-button", "aria-label": "Nothing to say this time" }, "Skip");
    if (asked === "label") {
      const known = WAYS.filter(([action]) => actions.includes(action));
      const others = actions.filter((action) => !(action in STEPS)).map((action) => [action, lowered(action), lowered(action)]);
      const ways = [...known, ...others].map(([action, sign, label]) =>
        this.button(way(action), { class: "way", "aria-label": label }, el("span", { "aria-hidden": "true" }, sign)));
      return [...ways, skip];
    }
    if (asked === "reward") {
      const judge = (sign, said) => this.button(said, { class: `judge ${inputOf(said)}` }, el("span", { "aria-hidden": "true" }, sign), said.label);
      return [judge("+", judgement(1)), judge("−", judgement(-1)), skip];
    }
    return [];
  }

  button(said, attributes, ...children) {
    const input = inputOf(said);
    return el("button", { ...attributes, "data-input": input, onclick: (event) => this.press(input, said, event) }, ...children);
  }

  enable(open) {
    for (const button of this.root.children) button.setAttribute("aria-disabled", String(!open));
  }

  /** Mark the button of what was said; null marks none. */
  choose(said) {
    for (const button of this.root.children) button.classList.toggle("chosen", said !== null && button.dataset.input === inputOf(said));
  }
}

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

/** Whether the actions are the four ways and nothing else. */
export const areWays = (actions) => actions.length === WAYS.length && actions.every((action) => action in STEPS);

/** The keys, for people to read. */
export const KEYS = [
  ["arrows, h j k l, w a s d", "the way you would go"],
  ["1 2 3 …", "an action by its number, where there are others"],
  ["+  p", "praise"],
  ["-  b", "blame"],
  ["u", "take it back, where that can be done"],
  ["space", "nothing to say"],
];

export const lowered = (action) => action.charAt(0) + action.slice(1).toLowerCase();

/** What naming a way says where this is asked: the way to go, one worth trying, or the one that would have been right. */
export function way(action, decision) {
  const label = lowered(action);
  if (decision.asked === "guidance") return { label, kind: "guidance", way: action, guidance: [action] };
  if (decision.asked === "mistake") {
    return { label: `${label} instead`, kind: "mistake", way: action, action, mistake: { first_step: decision.step, last_step: decision.step } };
  }
  return { label, kind: "label", way: action, action };
}

export const asksForAWay = (asked) => ["label", "guidance", "mistake"].includes(asked);
const nothing = { label: "Nothing to say", kind: "abstain" };
const undo = { label: "Take it back", kind: "undo" };
const judgement = (reward) => ({ label: reward > 0 ? "Good move" : "Bad move", kind: "reward", reward });

/** What a key says to a decision; null for a key that says nothing. */
export function saidByKey(key, decision) {
  const asked = decision?.asked;
  if (key === " ") return nothing;
  if (asksForAWay(asked) && key in LABEL_KEYS) return way(LABEL_KEYS[key], decision);
  if (asksForAWay(asked) && /^[1-9]$/.test(key) && key <= decision.actions.length) return way(decision.actions[key - 1], decision);
  if (asked === "reward" && key in REWARD_KEYS) return judgement(REWARD_KEYS[key]);
  if (asked === "reward" && key === "u" && decision.may_undo) return undo;
  return null;
}

function inputOf(said) {
  if (said.way) return said.way;
  if (said.reward) return said.reward > 0 ? "good" : "bad";
  return said.kind === "undo" ? "undo" : "skip";
}

export class Pad {
  /** press(input, said, event) is called for every button pressed. */
  constructor(press) {
    this.press = press;
    this.kind = "";
    this.root = el("div", { class: "pad", role: "group", "aria-labelledby": "asks" });
  }

  show(decision) {
    const kind = `${decision.asked} ${decision.may_undo} ${decision.actions.join(" ")}`;
    this.decision = decision;
    if (this.kind === kind) return;
    this.kind = kind;
    this.root.dataset.kind = asksForAWay(decision.asked) ? "ways" : decision.asked;
    this.root.replaceChildren(...this.buttons(decision));
  }

  buttons({ asked, actions, may_undo: mayUndo }) {
    const skip = this.button(() => nothing, { class: "skip-button", "aria-label": "Nothing to say this time" }, "Skip");
    if (asksForAWay(asked)) {
      const known = WAYS.filter(([action]) => actions.includes(action));
      const others = actions.filter((action) => !(action in STEPS)).map((action) => [action, lowered(action), lowered(action)]);
      const ways = [...known, ...others].map(([action, sign, label]) =>
        this.button(() => way(action, this.decision), { class: "way", "aria-label": label }, el("span", { "aria-hidden": "true" }, sign)));
      return [...ways, skip];
    }
    if (asked === "reward") {
      const judge = (sign, said) => this.button(() => said, { class: `judge ${inputOf(said)}` }, el("span", { "aria-hidden": "true" }, sign), said.label);
      const back = mayUndo ? [this.button(() => undo, { class: "undo-button" }, undo.label)] : [];
      return [judge("+", judgement(1)), judge("−", judgement(-1)), ...back, skip];
    }
    return asked === "nothing" ? [] : [skip];
  }

  /** `say` makes what the button says at the moment it is pressed. */
  button(say, attributes, ...children) {
    const input = inputOf(say());
    return el("button", { ...attributes, "data-input": input, onclick: (event) => this.press(input, say(), event) }, ...children);
  }

  enable(open) {
    for (const button of this.root.children) button.setAttribute("aria-disabled", String(!open));
  }

  /** Mark the button of what was said; null marks none. */
  choose(said) {
    for (const button of this.root.children) button.classList.toggle("chosen", said !== null && button.dataset.input === inputOf(said));
  }
}

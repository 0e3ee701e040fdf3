// The lesson: the agent's world, what is asked, and what became of every answer.

import { Board, inWords, sample } from "./board.js";
import { cry, el, say, seconds } from "./dom.js";
import { Gate } from "./gate.js";
import { keepsForGood, randomHex } from "./keep.js";
import { areWays, KEYS, Pad, asksForAWay, saidByKey, way } from "./pad.js";

const SWIPE_PX = 24;
const RESEND_MS = 3000;
const FATES = {
  sending: ["…", "sending"],
  waiting: ["…", "kept on this device, waiting for the network"],
  retrying: ["…", "kept, sent again"],
  saved: ["✓", "saved"],
  too_late: ["◷", "too late to count, but saved"],
  rejected: ["✕", "not taken"],
};
const OUTCOMES = { solved: "solved", deadlock: "stuck", failed: "failed", cap: "out of steps", running: "cut off" };
const still = matchMedia("(prefers-reduced-motion: reduce)");

const nameOf = (decision) => (decision ? `${decision.session}/${decision.epoch}/${decision.asked}/${decision.decision}` : null);
const wentBefore = (decision) => ["reward", "mistake"].includes(decision.asked) && Boolean(decision.action);

export class Teach {
  constructor(wire, outbox) {
    this.wire = wire;
    this.outbox = outbox;
    this.gate = new Gate();
    this.decision = null;
    this.deadline = null;
    this.painted = null;
    this.paintedAt = 0;
    this.online = false;
    this.latest = null; // {id, label, state, reason}
    this.build();
    this.timer = setInterval(() => this.tick(), 100);
    this.resender = setInterval(() => this.outbox.send(this.wire, RESEND_MS), 1000);
    this.onKey = (event) => this.key(event);
    addEventListener("keydown", this.onKey, true);
  }

  close() {
    clearInterval(this.timer);
    clearInterval(this.resender);
    removeEventListener("keydown", this.onKey, true);
  }

  // -------------------------------------------------------------- the screen

  build() {
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("role", "img");
    svg.id = "board";
    this.svg = svg;
    this.board = new Board(svg);
    this.asks = el("h1", { class: "asks", id: "asks" }, "Waiting for the agent");
    this.clock = el("span", { class: "clock", "aria-hidden": "true" });
    this.bar = el("i");
    this.fate = el("p", { class: "fate", "data-state": "none" }, el("b", { "aria-hidden": "true" }), el("span", {}, "Your answers show here."));
    this.pad = new Pad((input, said, event) => this.press(input, said, event));
    this.words = el("p", { class: "words" });
    this.rounds = el("ol", { class: "rounds", "aria-label": "Rounds so far" });
    this.purpose = el("p", {}, "The agent pushes every box onto a goal. It decides by itself, and learns from what you say.");
    this.roundsTitle = el("h2", {}, "Rounds so far, in steps");
    const keys = el("details", { class: "keys" }, el("summary", {}, "Keys and words"), this.words, this.keysList());
    const face = el("div", { class: "frame" }, svg);
    face.addEventListener("pointerdown", (event) => this.swipeFrom(event));
    this.face = face;
    this.root = el(
      "div", { class: "teach first" },
      face,
      el("section", { class: "side" },
        el("div", { class: "question" }, this.asks, this.clock, el("div", { class: "bar", "aria-hidden": "true" }, this.bar)),
        this.pad.root, this.fate,
        el("div", { class: "more" }, this.roundsTitle, this.rounds, this.about(), keys)),
    );
    if (!keepsForGood()) {
      this.root.prepend(el("p", { class: "warn" }, "This browser keeps nothing: do not reload while answers are being sent."));
    }
  }

  about() {
    const things = [["agent", "agent"], ["box", "box"], ["goal", "goal"], ["done", "in place"]];
    return el("div", { class: "about" },
      this.purpose,
      el("ul", { class: "legend" }, ...things.map(([kind, name]) => el("li", {}, sample(kind), name))));
  }

  keysList() {
    return el("dl", {}, ...KEYS.flatMap(([keys, what]) => [el("dt", {}, keys), el("dd", {}, what)]));
  }

  // -------------------------------------------------------------- what the agent's side says

  take(frame) {
    if (frame.type === "decision") this.show(frame);
    else if (frame.type === "episodes") this.count(frame.episodes);
    else if (frame.type === "answer") this.settle(frame);
    else if (frame.type === "link") this.away(frame);
  }

  show(decision) {
    const before = this.decision;
    if (nameOf(before) !== nameOf(decision)) this.before = before;
    this.decision = decision;
    this.deadline = decision.remaining_ms === null ? null : performance.now() + decision.remaining_ms;
    this.awayText = "";
    const world = before?.view === decision.view && before.session === decision.session ? this.board.world : this.board.show(decision.view);
    if (world?.other !== undefined) this.purpose.textContent = "The agent decides by itself, and learns from what you say.";
    this.pad.show(decision);
    this.mark();
    const asks = this.question();
    this.asks.textContent = asks;
    const isNew = nameOf(before) !== nameOf(decision);
    if (isNew || before.phase !== decision.phase) {
      const words = inWords(world);
      this.words.textContent = words;
      this.svg.setAttribute("aria-label", words);
      if (this.isOpen()) say("decision", `${asks} ${words}`);
      else if (decision.phase === "finished") say("decision", asks);
    }
    if (isNew && this.latest && !["sending", "waiting", "retrying"].includes(this.latest.state)) this.fadeFate();
    this.where();
    // A decision is shown once it is painted: a press before that still means the one before.
    const name = this.isOpen() ? nameOf(decision) : null;
    if (name === null) this.gate.show(null);
    requestAnimationFrame(() => setTimeout(() => this.paintedNow(name), 0));
    this.tick();
  }

  paintedNow(name) {
    if (name !== null && name !== (this.isOpen() ? nameOf(this.decision) : null)) return;
    if (name !== null && name !== this.painted) this.paintedAt = performance.now();
    this.painted = name;
    if (name !== null && this.lastAnswer()) this.gate.answer(name);
    this.gate.show(name);
    this.root.dataset.shown = name ?? "";
    this.enable();
  }

  isOpen() {
    const { decision } = this;
    return Boolean(decision) && decision.phase === "asking" && !decision.paused && decision.asked !== "nothing";
  }

  question() {
    const { decision } = this;
    if (this.awayText) return this.awayText;
    if (!decision) return "Waiting for the agent";
    if (decision.phase === "finished") return "The lesson is over. Thank you!";
    if (decision.paused) return "Paused";
    if (decision.phase === "gathering") return "Waiting for more teachers";
    if (decision.asked === "reward") return `It ${this.bumped() ? "could not go" : "went"} ${(decision.action ?? "").toLowerCase()}. A good move?`;
    if (decision.asked === "mistake") return `It went ${(decision.action ?? "").toLowerCase()}. A mistake? Which way instead?`;
    if (decision.asked === "guidance") return areWays(decision.actions) ? "Which way is worth trying?" : "What is worth trying?";
    if (decision.asked === "nothing") return "The agent learns by itself";
    if (decision.asked !== "label") return "Nothing that this page can answer is asked";
    return areWays(decision.actions) ? "Which way would you go?" : "What would you do?";
  }

  mark() {
    const { decision } = this;
    if (wentBefore(decision)) this.board.point(decision.action, this.bumped() ? "bumped" : "did");
    else this.board.point(this.lastAnswer()?.way, "said");
  }

  /** What was answered to the window on screen, over a reload and a restart of the learner too. */
  lastAnswer() {
    const { decision } = this;
    const last = this.outbox.last();
    return last?.session === decision.session && last.decision === decision.decision && last.asked === decision.asked ? last : null;
  }

  /** Whether the agent stands where it stood before the move that is judged. */
  bumped() {
    const { decision, before } = this;
    return [decision.decision, decision.decision - 1].includes(before?.decision) && before.session === decision.session && before.episode === decision.episode && before.view === decision.view;
  }

  where() {
    const { decision } = this;
    const where = document.getElementById("where");
    where.textContent = decision.phase === "finished" ? "" : `Round ${decision.episode + 1} of ${decision.episodes} · step ${decision.step + 1}`;
  }

  count(episodes) {
    this.rounds.replaceChildren(
      ...episodes.map((one) => {
        const text = one.outcome === "solved" ? `${one.steps}` : "–";
        const label = `Round ${one.episode + 1}: ${OUTCOMES[one.outcome]}, ${one.steps} steps${one.optimal ? `, ${one.optimal} would do` : ""}`;
        const height = one.outcome === "solved" && one.optimal ? Math.max(0.12, Math.min(1, one.optimal / Math.max(1, one.steps))) : 0.12;
        const bar = el("i", { "aria-hidden": "true" });
        bar.style.height = `${Math.round(height * 34)}px`;
        const item = el("li", { "data-outcome": one.outcome, title: label }, bar, el("span", { "aria-hidden": "true" }, text), el("span", { class: "hidden" }, label));
        return item;
      }),
    );
    this.root.classList.toggle("has-rounds", episodes.length > 0);
    this.root.classList.toggle("first", episodes.length === 0);
    const newest = episodes.at(-1);
    if (newest && this.counted !== undefined && newest.episode > this.counted) {
      say("round", `Round ${newest.episode + 1} is over: ${OUTCOMES[newest.outcome]} after ${newest.steps} steps.`);
    }
    this.counted = newest?.episode ?? -1;
  }

  away(frame) {
    if (frame.connected) return;
    if (!this.decision || this.decision.phase !== "finished") {
      this.awayText = "Waiting for the agent";
      this.asks.textContent = this.awayText;
    }
  }

  setOnline(online) {
    this.online = online;
    if (online) {
      this.outbox.unsent();
      this.outbox.send(this.wire, 0);
    }
    if (this.latest && this.outbox.entries.has(this.latest.id)) {
      this.tellFate(this.latest.id, this.latest.label, online ? "sending" : "waiting", "");
    } else if (online && this.outbox.size) {
      const [id, entry] = [...this.outbox.entries].at(-1);
      this.tellFate(id, entry.label, "sending", "");
    }
    this.enable();
  }

  // -------------------------------------------------------------- time

  tick() {
    const { decision } = this;
    const left = this.deadline === null ? null : this.deadline - performance.now();
    const shown = this.isOpen() && left !== null && decision.window.mode !== "until-answered";
    this.root.classList.toggle("timed", shown);
    if (!shown) {
      this.clock.textContent = "";
      return;
    }
    const text = seconds(still.matches ? Math.ceil(left / 500) * 500 : left);
    if (this.clock.textContent !== text) this.clock.textContent = text;
    const share = Math.max(0, Math.min(1, left / decision.window.span_ms));
    this.bar.style.transform = `scaleX(${still.matches ? Math.ceil(share * 8) / 8 : share})`;
    this.root.classList.toggle("soon", left < Math.min(1500, decision.window.span_ms * 0.3));
  }

  enable() {
    const open = this.gate.open;
    this.pad.enable(open);
    this.root.classList.toggle("open", open);
  }

  // -------------------------------------------------------------- hands

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing) return;
    const target = event.target;
    if (target instanceof HTMLInputElement || target instanceof HTMLTextAreaElement || document.querySelector("dialog[open]")) return;
    const onButton = target instanceof HTMLElement && target.closest("button, summary, a");
    if (onButton && (event.key === "Enter" || event.key === " ")) {
      // The button speaks for itself, but a key held down on it is one press.
      if (event.repeat) event.preventDefault();
      return;
    }
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const said = saidByKey(key, this.decision);
    if (said === null) return;
    this.press(key, said, event);
    event.preventDefault();
  }

  swipeFrom(start) {
    if (!start.isPrimary) return;
    const [x, y] = [start.clientX, start.clientY];
    const end = (event) => {
      removeEventListener("pointerup", end);
      removeEventListener("pointercancel", end);
      const [right, down] = [event.clientX - x, event.clientY - y];
      if (event.type === "pointercancel" || Math.max(Math.abs(right), Math.abs(down)) < SWIPE_PX) return;
      if (!asksForAWay(this.decision?.asked)) return;
      const across = Math.abs(right) > Math.abs(down);
      const action = across ? (right > 0 ? "RIGHT" : "LEFT") : down > 0 ? "DOWN" : "UP";
      this.press(`swipe ${action}`, way(action, this.decision), event);
    };
    addEventListener("pointerup", end);
    addEventListener("pointercancel", end);
  }

  press(input, said, event) {
    const { decision } = this;
    if (said.way && !decision.actions.includes(said.way)) return;
    const verdict = this.gate.press(input, performance.now(), event.repeat === true);
    if (verdict === "already") this.hint("This one has your answer.");
    else if (verdict === "closed") this.hint(decision?.paused ? "Paused: not counted." : "Nothing was asked: not counted.");
    if (verdict !== "counts") return;
    const frame = {
      type: "answer",
      id: randomHex(16),
      session: decision.session,
      epoch: decision.epoch,
      decision: decision.decision,
      episode: decision.episode,
      step: decision.step,
      state: decision.state,
      kind: said.kind,
      action: said.kind === "reward" ? decision.action : (said.action ?? null),
      reward: said.reward ?? null,
      guidance: said.guidance ?? [],
      mistake: said.mistake ?? null,
      response_ms: Math.max(0, Math.round(performance.now() - this.paintedAt)),
    };
    this.outbox.put(frame, said.label, { asked: decision.asked, way: said.way ?? null });
    this.tellFate(frame.id, said.label, this.online ? "sending" : "waiting", "");
    this.outbox.send(this.wire, RESEND_MS);
    if (said.way && !wentBefore(decision)) this.board.point(said.way, "said");
    this.pad.choose(said);
    this.enable();
  }

  // -------------------------------------------------------------- what became of an answer

  settle(frame) {
    const entry = this.outbox.entries.get(frame.id);
    if (!entry) return;
    if (frame.state === "sending") return;
    if (frame.state !== "retrying") this.outbox.settle(frame.id);
    if (frame.state === "rejected") {
      this.outbox.reopen(frame.id);
      this.gate.reopen(nameOf(this.decision));
      this.enable();
    }
    if (this.latest === null || this.latest.id === frame.id || this.latest.state !== "sending") {
      this.tellFate(frame.id, entry.label, frame.state, frame.state === "rejected" ? frame.reason : "");
    }
  }

  tellFate(id, label, state, reason) {
    const [sign, words] = FATES[state];
    this.latest = { id, label, state };
    const others = state === "saved" && this.decision?.teachers > 1 && !this.gate.open && this.isOpen() ? ". Waiting for the others" : "";
    const more = this.outbox.size > 1 ? ` (${this.outbox.size} answers on their way)` : "";
    this.fate.dataset.state = state;
    this.fate.classList.remove("old");
    this.fate.children[0].textContent = sign;
    const text = `${label}: ${words}${reason ? `: ${reason}` : ""}${more}${others}`;
    this.fate.children[1].textContent = text;
    if (state === "rejected") cry(text);
    else if (state !== "sending") say("fate", `${text}.`);
  }

  fadeFate() {
    this.fate.classList.add("old");
    this.fate.children[1].textContent = `${this.latest.label}: ${FATES[this.latest.state][1]}`;
    this.pad.choose(null);
  }

  hint(text) {
    this.fate.classList.remove("old");
    this.fate.dataset.state = "hint";
    this.fate.children[0].textContent = "·";
    this.fate.children[1].textContent = text;
    this.latest = this.latest && this.outbox.entries.has(this.latest.id) ? this.latest : null;
    say("fate", text);
  }
}

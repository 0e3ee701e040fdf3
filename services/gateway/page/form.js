// A screen to read and fill in: text, fields, buttons, a code to copy, a link to go on to.

import { cry, el } from "./dom.js";

const lacking = (count) => (count === 1 ? "One answer is still missing." : `${count} answers are still missing.`);
const empty = (value) => value === null || value === "" || value === false;

export class Form {
  constructor(wire, screen) {
    this.wire = wire;
    this.screen = screen;
    this.getters = new Map();
    this.problem = el("p", { class: "problem", id: "problem" });
    this.root = el(
      "form", { class: "card form", novalidate: true, onsubmit: (event) => event.preventDefault() },
      el("h1", {}, screen.title),
      ...screen.text.map((paragraph) => el("p", {}, paragraph)),
      ...screen.fields.map((field) => this.field(field)),
      screen.code ? this.code(screen.code) : null,
      screen.link?.startsWith("https://") ? el("p", {}, el("a", { class: "go", href: screen.link, rel: "noreferrer" }, screen.link_label || screen.link)) : null,
      this.problem,
      el("div", { class: "row" }, ...screen.buttons.map((button) => this.button(button))),
    );
    for (const name of ["input", "pointerdown", "keydown"]) this.root.addEventListener(name, () => this.recount());
  }

  close() {}

  take() {}

  setOnline(online) {
    for (const button of this.root.querySelectorAll("button")) button.disabled = !online;
  }

  code(code) {
    const done = el("span", { role: "status" });
    const copy = el("button", { type: "button", class: "quiet", onclick: () => navigator.clipboard?.writeText(code).then(() => { done.textContent = " copied"; }) }, "Copy");
    return el("p", { class: "code" }, el("code", {}, code), copy, done);
  }

  field(field) {
    const id = `field-${field.name}`;
    const help = field.help ? el("p", { class: "help", id: `${id}-help` }, field.help) : null;
    const described = field.help ? { "aria-describedby": `${id}-help` } : {};
    const box = el("div", { class: `field ${field.kind}`, "data-field": field.name });
    const label = () => el("label", { for: id }, field.label, field.required ? "" : " (optional)");
    if (field.kind === "check") {
      const input = el("input", { type: "checkbox", id, ...described });
      this.getters.set(field.name, () => input.checked);
      box.append(el("label", { class: "check" }, input, el("span", {}, field.label)));
    } else if (field.kind === "choice") {
      const group = el("fieldset", {}, el("legend", {}, field.label));
      for (const choice of field.choices) group.append(el("label", { class: "check" }, el("input", { type: "radio", name: id, value: choice }), el("span", {}, choice)));
      this.getters.set(field.name, () => group.querySelector("input:checked")?.value ?? null);
      box.append(group);
    } else if (field.kind === "scale") {
      const input = el("input", { type: "range", id, min: field.low, max: field.high, step: field.step, value: (field.low + field.high) / 2, class: "untouched", ...described });
      const touch = () => input.classList.remove("untouched");
      for (const name of ["input", "pointerdown", "keydown"]) input.addEventListener(name, touch);
      this.getters.set(field.name, () => (input.classList.contains("untouched") ? null : Number(input.value)));
      box.append(label(), input, el("div", { class: "ends", "aria-hidden": "true" }, el("span", {}, field.low_label), el("span", {}, field.high_label)));
    } else {
      const number = field.kind === "number";
      const input = number
        ? el("input", { type: "number", id, min: field.low, max: field.high, step: field.step, inputmode: "decimal", ...described })
        : el("textarea", { id, rows: 2, maxlength: field.length_max, ...described });
      this.getters.set(field.name, () => (input.value === "" ? null : number ? Number(input.value) : input.value));
      box.append(label(), input);
    }
    if (help) box.append(help);
    return box;
  }

  button(button) {
    return el("button", { type: "button", class: button.danger ? "danger" : "main", "data-button": button.name, onclick: () => this.press(button) }, button.label);
  }

  press(button) {
    if (button.confirm && !confirm(button.confirm)) return;
    const values = {};
    const missing = [];
    for (const field of this.screen.fields) {
      const value = this.getters.get(field.name)();
      values[field.name] = value;
      const box = this.root.querySelector(`[data-field="${field.name}"]`);
      const lacks = button.fills && field.required && empty(value);
      box.classList.toggle("lacks", lacks);
      if (lacks) missing.push(box);
    }
    if (missing.length) {
      this.refused(lacking(missing.length));
      missing[0].querySelector("input, textarea")?.focus();
      return;
    }
    this.problem.textContent = "";
    this.wire.send({ type: "submit", screen: this.screen.name, button: button.name, values: button.fills ? values : {} });
  }

  // What was missing may have been given since: the line says what still is.
  recount() {
    const boxes = [...this.root.querySelectorAll(".lacks")];
    if (!boxes.length) return;
    const left = boxes.filter((box) => empty(this.getters.get(box.dataset.field)()));
    for (const box of boxes) box.classList.toggle("lacks", left.includes(box));
    this.problem.textContent = left.length ? lacking(left.length) : "";
  }

  refused(text) {
    this.problem.textContent = text;
    cry(text);
  }
}

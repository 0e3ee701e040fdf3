// The page: who we are, the connection, and whichever screen the gateway names.

import { cry, el } from "./dom.js";
import { Form } from "./form.js";
import * as keep from "./keep.js";
import { Teach } from "./teach.js";
import { Wire } from "./wire.js";

const NET = { connecting: "connecting", online: "connected", offline: "no connection" };
const AGAIN = {
  "taken-over": ["You went on in another tab", "Only one tab at a time teaches, so that no answer is given twice. What you answered here is kept.", "Go on in this tab"],
  flood: ["Too many messages", "The page was let go. Wait a minute, then go on.", "Go on"],
  "hello-rate": ["Too many connections", "The page was opened too often in a short time. Wait a minute, then go on.", "Go on"],
  idle: ["Still there?", "Nothing was heard from you for a long time.", "Go on"],
  people: ["It is full", "Too many people are here at once. Try again later.", "Try again"],
};
const main = document.getElementById("main");
const menu = document.getElementById("menu");

class App {
  constructor() {
    this.token = keep.takeToken();
    this.screen = null;
    this.shown = "";
    this.outbox = null;
    this.online = false;
    this.wire = new Wire(() => this.hello(), (frame) => this.take(frame), (state) => this.net(state));
    if (this.token) this.wire.open();
    else this.card("A link is needed", "Open the link, or scan the code, that you were given: it says which lesson you take part in.");
  }

  hello() {
    return { type: "hello", version: 1, token: this.token, nonce: keep.nonce(), arrival: keep.arrival() };
  }

  net(state) {
    document.getElementById("net").dataset.state = state;
    document.getElementById("net-text").textContent = NET[state];
    this.online = state === "online";
    if (!this.online) this.screen?.setOnline?.(false);
  }

  take(frame) {
    if (frame.type === "you") this.know(frame);
    else if (frame.type === "screen") this.show(frame.screen);
    else if (frame.type === "refused") this.refused(frame);
    else this.screen?.take(frame);
  }

  know(frame) {
    keep.keepToken(frame.token, this.token);
    this.token = frame.token;
    if (this.outbox === null || this.pseudonym !== frame.pseudonym) this.outbox = new keep.Outbox(frame.pseudonym, frame.token);
    this.pseudonym = frame.pseudonym;
    document.documentElement.dataset.who = frame.pseudonym;
  }

  show(screen) {
    const same = JSON.stringify(screen) === this.shown;
    this.shown = JSON.stringify(screen);
    if (!same || this.screen === null) {
      this.screen?.close();
      this.screen = screen.session === null ? new Form(this.wire, screen) : new Teach(this.wire, this.outbox);
      main.replaceChildren(this.screen.root);
      document.getElementById("where").textContent = "";
      document.title = screen.title ? `${screen.title} · SfID` : "Teach · SfID";
      this.offer(screen);
      if (screen.session === null) main.focus();
    }
    this.screen.setOnline(this.online);
  }

  offer(screen) {
    const press = (button) => () => {
      if (!button.confirm || confirm(button.confirm)) this.wire.send({ type: "submit", screen: screen.name, button: button.name, values: {} });
    };
    const buttons = screen.session === null ? [] : screen.buttons;
    menu.replaceChildren(...buttons.map((button) => el("button", { class: "quiet", "data-button": button.name, onclick: press(button) }, button.label)));
  }

  refused(frame) {
    if (!frame.final) {
      if (this.screen?.refused) this.screen.refused(frame.text);
      else if (frame.text) cry(frame.text);
      return;
    }
    this.screen?.close();
    this.screen = null;
    this.shown = "";
    const again = AGAIN[frame.reason];
    if (again) {
      this.card(again[0], again[1], again[2]);
      return;
    }
    if (frame.reason.endsWith("-token") || frame.reason === "invitation-full") keep.dropToken(this.token);
    this.card("This lesson cannot be opened", `${frame.text.charAt(0).toUpperCase()}${frame.text.slice(1)}.`);
  }

  card(title, text, again) {
    menu.replaceChildren();
    document.getElementById("where").textContent = "";
    document.getElementById("net").hidden = true;
    const go = again
      ? el("button", { class: "main", id: "again", onclick: () => {
          document.getElementById("net").hidden = false;
          main.replaceChildren(el("section", { class: "card" }, el("p", {}, "Opening the lesson …")));
          this.wire.start();
        } }, again)
      : null;
    main.replaceChildren(el("section", { class: "card", id: "message" }, el("h1", {}, title), el("p", {}, text), go));
    cry(`${title}. ${text}`);
  }
}

new App();

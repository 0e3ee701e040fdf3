// What this browser keeps: who we are here, and answers that nobody has acknowledged yet.

const memory = new Map();
let lasting = true;

function store(kind, key, value) {
  try {
    if (value === null) kind().removeItem(key);
    else kind().setItem(key, value);
    return true;
  } catch {
    // No room, or storage is switched off: this page still works, but a reload forgets.
    if (value === null) memory.delete(key);
    else memory.set(key, value);
    lasting = false;
    return false;
  }
}

function load(kind, key) {
  try {
    return kind().getItem(key) ?? memory.get(key) ?? null;
  } catch {
    return memory.get(key) ?? null;
  }
}

const local = () => localStorage;
const tab = () => sessionStorage;

/** Whether what is kept outlives this page. */
export const keepsForGood = () => lasting;

export function randomHex(bytes) {
  return Array.from(crypto.getRandomValues(new Uint8Array(bytes)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

// ---------------------------------------------------------------- who we are

/** The token of this tab: from the address, else from before. It leaves the address bar, and so history and screenshots. */
export function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("t");
  if (given) {
    const known = load(local, `sfid.for.${given}`);
    keepToken(known ?? given, null);
    store(tab, "sfid.arrival", location.search);
    history.replaceState(null, "", location.pathname);
    return known ?? given;
  }
  return load(tab, "sfid.token") ?? load(local, "sfid.token");
}

/** Keep the token we were given, and for which invitation, so that the same link is the same person here. */
export function keepToken(token, invitation) {
  store(tab, "sfid.token", token);
  store(local, "sfid.token", token);
  if (invitation && invitation !== token) store(local, `sfid.for.${invitation}`, token);
}

/** Forget a token that is worthless, so that the next link starts afresh. */
export function dropToken(token) {
  for (const kind of [tab, local]) if (load(kind, "sfid.token") === token) store(kind, "sfid.token", null);
  try {
    for (const key of Object.keys(localStorage)) {
      if (key.startsWith("sfid.for.") && localStorage.getItem(key) === token) localStorage.removeItem(key);
    }
  } catch {
    memory.clear();
  }
}

/** One number a browser, so that a lost reply to an invitation does not cost a second place. */
export function nonce() {
  let found = load(local, "sfid.nonce");
  if (!found) {
    found = randomHex(16);
    store(local, "sfid.nonce", found);
  }
  return found;
}

/** The parameters of the address we came by. */
export function arrival() {
  const pairs = [...new URLSearchParams(load(tab, "sfid.arrival") ?? location.search)];
  return Object.fromEntries(pairs.filter(([key, value]) => key.length <= 256 && value.length <= 256).slice(0, 24).reverse());
}

// ---------------------------------------------------------------- the outbox

export class Outbox {
  constructor(pseudonym, token) {
    this.prefix = `sfid.out.${pseudonym}.`;
    // By token: a session of the same name elsewhere, or later, counts its decisions from 0 again.
    this.marker = `sfid.said.${token.slice(-16)}`;
    this.entries = new Map();
    let keys = [];
    try {
      keys = Object.keys(localStorage);
    } catch {
      keys = [];
    }
    const found = keys
      .filter((key) => key.startsWith(this.prefix))
      .map((key) => [key.slice(this.prefix.length), JSON.parse(localStorage.getItem(key))])
      .sort(([, one], [, other]) => one.at - other.at);
    for (const [id, entry] of found) this.entries.set(id, { ...entry, sent: 0 });
  }

  get size() {
    return this.entries.size;
  }

  /** Keep an answer; only then may it be sent. */
  put(frame, label, { asked, way }) {
    const entry = { at: Date.now(), frame, label };
    store(local, this.prefix + frame.id, JSON.stringify(entry));
    store(local, this.marker, JSON.stringify({ session: frame.session, decision: frame.decision, id: frame.id, asked, way }));
    this.entries.set(frame.id, { ...entry, sent: 0 });
  }

  /** Forget an answer whose fate is known, and return what it was. */
  settle(id) {
    const entry = this.entries.get(id);
    this.entries.delete(id);
    store(local, this.prefix + id, null);
    return entry;
  }

  /** Send what has waited for `quiet` ms or more. */
  send(wire, quiet) {
    const now = performance.now();
    for (const entry of this.entries.values()) {
      if (!entry.sent || now - entry.sent >= quiet) {
        if (!wire.send(entry.frame)) return;
        entry.sent = now || 1;
      }
    }
  }

  /** After a lost connection nothing counts as sent. */
  unsent() {
    for (const entry of this.entries.values()) entry.sent = 0;
  }

  /** The last answer that was given here, over a reload too. */
  last() {
    return JSON.parse(load(local, this.marker) ?? "null");
  }

  /** The last answer was not taken: its decision is open again. */
  reopen(id) {
    if (this.last()?.id === id) store(local, this.marker, null);
  }
}

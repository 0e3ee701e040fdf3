// Building elements without markup in strings: nothing that comes over the wire is ever read as HTML.

export function el(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "class") element.className = value;
    else if (value === true) element.setAttribute(key, "");
    else element.setAttribute(key, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

const live = document.getElementById("live");
const alert = document.getElementById("alert");
const SETTLE_MS = 350;
const waiting = new Map();
let timer = 0;

/** Say something to a screen reader, politely. Of one `topic` only the newest is said, once things have settled. */
export function say(topic, text) {
  waiting.delete(topic);
  waiting.set(topic, text);
  clearTimeout(timer);
  timer = setTimeout(() => {
    live.textContent = [...waiting.values()].join(" ");
    waiting.clear();
  }, SETTLE_MS);
}

/** Say something at once: it is important. */
export function cry(text) {
  alert.textContent = "";
  requestAnimationFrame(() => {
    alert.textContent = text;
  });
}

export function seconds(ms) {
  return `${(Math.max(0, ms) / 1000).toFixed(1)} s`;
}

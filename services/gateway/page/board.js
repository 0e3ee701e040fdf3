// The world as a picture and in words, from the XSB view of a decision.

const NS = "http://www.w3.org/2000/svg";
const CELL = 40;
export const STEPS = { LEFT: [0, -1], RIGHT: [0, 1], UP: [-1, 0], DOWN: [1, 0] };

/** Read a view into cells; the floor beyond the walls is no floor. */
export function read(view) {
  const rows = view.split("\n");
  const height = rows.length;
  const width = Math.max(...rows.map((row) => row.length));
  const at = (row, column) => rows[row]?.[column] ?? " ";
  const world = { width, height, walls: new Set(), goals: new Set(), boxes: new Set(), agent: null, outside: new Set() };
  for (let row = 0; row < height; row += 1) {
    for (let column = 0; column < width; column += 1) {
      const mark = at(row, column);
      const place = row * width + column;
      if (mark === "#") world.walls.add(place);
      if (".+*".includes(mark)) world.goals.add(place);
      if ("$*".includes(mark)) world.boxes.add(place);
      if ("@+".includes(mark)) world.agent = place;
    }
  }
  markOutside(world);
  return world;
}

/** Whether a view is a Sokoban board, and not what another world shows: text, or a picture. */
export const isBoard = (view) => view.includes("#") && /^[#@+$*. _\n-]+$/.test(view);

const PICTURE = "data:image/png;base64,";
const LETTER = [10, 20];

function markOutside(world) {
  const { width, height } = world;
  const inside = new Set();
  const open = world.agent === null ? [] : [world.agent];
  while (open.length) {
    const place = open.pop();
    if (inside.has(place) || world.walls.has(place)) continue;
    inside.add(place);
    const [row, column] = [Math.floor(place / width), place % width];
    if (row > 0) open.push(place - width);
    if (row < height - 1) open.push(place + width);
    if (column > 0) open.push(place - 1);
    if (column < width - 1) open.push(place + 1);
  }
  for (let place = 0; place < width * height; place += 1) {
    if (!inside.has(place) && !world.walls.has(place) && !world.boxes.has(place) && !world.goals.has(place)) {
      world.outside.add(place);
    }
  }
}

// ---------------------------------------------------------------- in words

const NAMES = { LEFT: "left", RIGHT: "right", UP: "up", DOWN: "down" };

function whatIs(world, place, beyond) {
  if (place === null || world.walls.has(place)) return "wall";
  if (world.boxes.has(place)) {
    const box = world.goals.has(place) ? "box on its goal" : "box";
    const stuck = beyond === null || world.walls.has(beyond) || world.boxes.has(beyond);
    return stuck ? `${box}, which cannot move` : box;
  }
  return world.goals.has(place) ? "goal" : "free";
}

function step(world, place, [down, right], times) {
  const row = Math.floor(place / world.width) + down * times;
  const column = (place % world.width) + right * times;
  const within = row >= 0 && row < world.height && column >= 0 && column < world.width;
  return within ? row * world.width + column : null;
}

function spot(world, place) {
  const down = Math.floor(place / world.width) - Math.floor(world.agent / world.width);
  const right = (place % world.width) - (world.agent % world.width);
  const parts = [];
  if (down) parts.push(`${Math.abs(down)} ${down < 0 ? "up" : "down"}`);
  if (right) parts.push(`${Math.abs(right)} ${right < 0 ? "left" : "right"}`);
  return parts.join(" and ") || "under the agent";
}

/** Say what there is: around the agent first, then boxes and goals by their distance from it. */
export function inWords(world) {
  if (world.other !== undefined) return world.other.startsWith(PICTURE) ? "The state is a picture." : world.other;
  if (world.agent === null) return "There is no agent to be seen.";
  const around = Object.entries(STEPS)
    .map(([name, delta]) => `${NAMES[name]} ${whatIs(world, step(world, world.agent, delta, 1), step(world, world.agent, delta, 2))}`)
    .join("; ");
  const loose = [...world.boxes].filter((place) => !world.goals.has(place));
  const free = [...world.goals].filter((place) => !world.boxes.has(place));
  const done = world.boxes.size - loose.length;
  const list = (places) => places.map((place) => spot(world, place)).join(", ");
  const boxes = loose.length ? `Boxes to move: ${list(loose)}.` : "All boxes stand on goals.";
  const goals = free.length ? `Free goals: ${list(free)}.` : "";
  return `Around the agent: ${around}. ${boxes} ${goals} ${done} of ${world.boxes.size} boxes in place.`.replace(/\s+/g, " ");
}

// ---------------------------------------------------------------- as a picture

function make(name, attributes, parent) {
  const element = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  parent?.append(element);
  return element;
}

const FLOOR = ["#3b3543", "#37313f"];
const MORTAR = "#2b2731";

function drawFloor(parent, x, y, odd) {
  make("rect", { x, y, width: CELL, height: CELL, fill: FLOOR[odd] }, parent);
  make("path", { d: `M${x + 0.5} ${y + CELL}V${y + 0.5}H${x + CELL}`, fill: "none", stroke: "#443d4d", "stroke-width": 1 }, parent);
}

function drawWall(parent, x, y, face) {
  make("rect", { x, y, width: CELL, height: CELL, fill: "#8a97b8" }, parent);
  make("path", { d: `M${x + 1} ${y + CELL}V${y + 1}H${x + CELL}`, fill: "none", stroke: "#a9b5d1", "stroke-width": 2 }, parent);
  make("path", { d: `M${x + CELL - 1} ${y + 1}V${y + CELL}`, fill: "none", stroke: "#74819f", "stroke-width": 2 }, parent);
  if (!face) return;
  make("rect", { x, y: y + 24, width: CELL, height: 16, fill: "#4d5877" }, parent);
  make("path", { d: `M${x} ${y + 32}h${CELL}M${x + 13} ${y + 24}v8M${x + 33} ${y + 24}v8M${x + 6} ${y + 32}v8M${x + 23} ${y + 32}v8`, stroke: "#3c4661", "stroke-width": 2, fill: "none" }, parent);
}

function drawGoal(parent, x, y) {
  const [cx, cy] = [x + CELL / 2, y + CELL / 2];
  make("path", { d: `M${cx} ${cy - 14}L${cx + 14} ${cy}L${cx} ${cy + 14}L${cx - 14} ${cy}Z`, fill: "#f0e4421f", stroke: "#f0e442", "stroke-width": 2.6, "stroke-linejoin": "round", "shape-rendering": "geometricPrecision" }, parent);
  make("path", { d: `M${cx} ${cy - 5}L${cx + 5} ${cy}L${cx} ${cy + 5}L${cx - 5} ${cy}Z`, fill: "#f0e442", "shape-rendering": "geometricPrecision" }, parent);
}

function drawBox(parent, done) {
  const box = make("g", { class: "piece" }, parent);
  const [wood, dark, light] = done ? ["#0e9d75", "#06644a", "#3dc39d"] : ["#e0912f", "#8a4f10", "#f4b562"];
  make("ellipse", { cx: 20, cy: 36, rx: 16, ry: 3, fill: "#0005" }, box);
  make("rect", { x: 4, y: 4, width: 32, height: 32, rx: 3, fill: dark }, box);
  make("rect", { x: 6, y: 6, width: 28, height: 28, rx: 1.5, fill: wood }, box);
  make("path", { d: "M6 15.3h28M6 24.6h28", stroke: dark, "stroke-width": 1.8 }, box);
  make("path", { d: "M8 7.5h24", stroke: light, "stroke-width": 2, "stroke-linecap": "round" }, box);
  make("path", { d: "M9.5 11.2h5M22 20.2h7M11 29.6h6", stroke: light, "stroke-width": 1.4, "stroke-linecap": "round", opacity: 0.75 }, box);
  if (done) make("path", { d: "M11.5 20.5l6 6.2 11.5-13", fill: "none", stroke: "#fff", "stroke-width": 4.6, "stroke-linecap": "round", "stroke-linejoin": "round" }, box);
  return box;
}

function drawAgent(parent) {
  const agent = make("g", { class: "piece agent" }, parent);
  make("ellipse", { cx: 20, cy: 37, rx: 12, ry: 2.6, fill: "#0006" }, agent);
  make("rect", { x: 13, y: 30.5, width: 5.6, height: 6.5, rx: 2, fill: "#2a3350" }, agent);
  make("rect", { x: 21.4, y: 30.5, width: 5.6, height: 6.5, rx: 2, fill: "#2a3350" }, agent);
  make("rect", { x: 7.6, y: 20.5, width: 5.6, height: 10.5, rx: 2.8, fill: "#f2c9a1" }, agent);
  make("rect", { x: 26.8, y: 20.5, width: 5.6, height: 10.5, rx: 2.8, fill: "#f2c9a1" }, agent);
  make("rect", { x: 11, y: 19, width: 18, height: 14, rx: 4.5, fill: "#3f8fd6" }, agent);
  make("path", { d: "M14.5 19v5.5h11V19", fill: "#7cbcf0" }, agent);
  make("circle", { cx: 20, cy: 13, r: 8.6, fill: "#f7d3ad" }, agent);
  make("path", { d: "M10.6 12.4C10.6 6 14.6 3 20 3s9.4 3 9.4 9.4c-3.1-2-15.7-2-18.8 0z", fill: "#7a4a24" }, agent);
  make("path", { d: "M8.6 12.7c3.8-2.5 19-2.5 22.8 0", fill: "none", stroke: "#5b3517", "stroke-width": 2.4, "stroke-linecap": "round" }, agent);
  const face = make("g", { class: "face" }, agent);
  make("circle", { cx: 17, cy: 15.6, r: 1.35, fill: "#2a2230" }, face);
  make("circle", { cx: 23, cy: 15.6, r: 1.35, fill: "#2a2230" }, face);
  return agent;
}

const ARROWS = { LEFT: 180, RIGHT: 0, UP: -90, DOWN: 90 };

function place(element, world, cell) {
  const [row, column] = [Math.floor(cell / world.width), cell % world.width];
  element.style.transform = `translate(${column * CELL}px, ${row * CELL}px)`;
  element.dataset.cell = cell;
}

/** A small picture of one thing, for a legend. */
export function sample(kind) {
  const svg = make("svg", { viewBox: `0 0 ${CELL} ${CELL}`, class: "sample", "aria-hidden": "true" });
  drawFloor(svg, 0, 0, 0);
  if (kind === "agent") drawAgent(svg);
  else if (kind === "goal") drawGoal(svg, 0, 0);
  else drawBox(svg, kind === "done");
  return svg;
}

export class Board {
  /** Draws into an svg element; pieces that moved are moved, so that the eye can follow. */
  constructor(svg) {
    this.svg = svg;
    this.world = null;
    this.ground = "";
    this.boxes = new Map();
  }

  show(view) {
    if (!isBoard(view)) return this.showOther(view);
    const world = read(view);
    const ground = JSON.stringify([world.width, world.height, [...world.walls], [...world.goals]]);
    if (ground !== this.ground) this.build(world);
    this.ground = ground;
    this.world = world;
    this.moveBoxes(world);
    if (world.agent !== null) {
      if (!this.agent) this.agent = drawAgent(this.pieces);
      this.pieces.append(this.agent);
      this.look(this.agent.dataset.cell, world);
      place(this.agent, world, world.agent);
    }
    this.point(null);
    return world;
  }

  /** Show another world: its text as it stands, or its picture. */
  showOther(view) {
    const lines = view.split("\n");
    const isPicture = view.startsWith(PICTURE);
    const [across, down] = isPicture ? [400, 400] : [Math.max(...lines.map((line) => line.length), 1) * LETTER[0], lines.length * LETTER[1]];
    this.ground = "";
    this.agent = null;
    this.marks = null;
    this.svg.replaceChildren();
    this.svg.setAttribute("viewBox", `0 0 ${across} ${down}`);
    this.svg.style.setProperty("--ratio", across / down);
    if (isPicture) make("image", { href: view, width: across, height: down }, this.svg);
    else {
      make("rect", { width: across, height: down, fill: MORTAR }, this.svg);
      for (const [row, line] of lines.entries()) {
        const place = { x: 0, y: (row + 0.75) * LETTER[1], textLength: line.length * LETTER[0], "xml:space": "preserve", class: "letters" };
        if (line) make("text", place, this.svg).textContent = line;
      }
    }
    this.world = { other: view, agent: null };
    return this.world;
  }

  build(world) {
    this.svg.replaceChildren();
    this.svg.setAttribute("viewBox", `0 0 ${world.width * CELL} ${world.height * CELL}`);
    this.svg.style.setProperty("--ratio", world.width / world.height);
    const ground = make("g", { "shape-rendering": "crispEdges" }, this.svg);
    make("rect", { width: world.width * CELL, height: world.height * CELL, fill: MORTAR }, ground);
    for (let cell = 0; cell < world.width * world.height; cell += 1) {
      const [row, column] = [Math.floor(cell / world.width), cell % world.width];
      const [x, y] = [column * CELL, row * CELL];
      if (world.outside.has(cell)) make("rect", { x, y, width: CELL, height: CELL, class: "outside" }, ground);
      else if (world.walls.has(cell)) drawWall(ground, x, y, !world.walls.has(cell + world.width) && !world.outside.has(cell + world.width));
      else drawFloor(ground, x, y, (row + column) % 2);
      if (world.goals.has(cell)) drawGoal(ground, x, y);
    }
    this.pieces = make("g", {}, this.svg);
    this.marks = make("g", { class: "marks" }, this.svg);
    this.boxes = new Map();
    this.agent = null;
  }

  moveBoxes(world) {
    const gone = [...this.boxes.keys()].filter((cell) => !world.boxes.has(cell));
    const come = [...world.boxes].filter((cell) => !this.boxes.has(cell));
    const [from, to] = [gone[0], come[0]];
    if (gone.length === 1 && come.length === 1 && world.goals.has(from) === world.goals.has(to)) {
      const box = this.boxes.get(from);
      this.boxes.delete(from);
      this.boxes.set(to, box);
      place(box, world, to);
      return;
    }
    for (const cell of gone) {
      this.boxes.get(cell).remove();
      this.boxes.delete(cell);
    }
    for (const cell of come) {
      const box = drawBox(this.pieces, world.goals.has(cell));
      place(box, world, cell);
      this.boxes.set(cell, box);
    }
  }

  look(before, world) {
    const moved = before === undefined ? 0 : world.agent - Number(before);
    const way = { 1: [2.4, 0], [-1]: [-2.4, 0], [world.width]: [0, 1.2], [-world.width]: [0, -1.6] }[moved];
    if (way) this.agent.querySelector(".face").setAttribute("transform", `translate(${way[0]} ${way[1]})`);
  }

  /** Draw an arrow at the agent: what was answered ("said"), what it did ("did") or failed to do ("bumped"). */
  point(action, kind) {
    this.marks?.replaceChildren();
    if (!action || !(action in ARROWS) || !this.world || this.world.agent === null) return;
    const { width, agent } = this.world;
    const [down, right] = STEPS[action];
    const ahead = kind === "did" ? -0.86 : 0.82; // where it came from, or where it would go
    const x = ((agent % width) + 0.5 + right * ahead) * CELL;
    const y = (Math.floor(agent / width) + 0.5 + down * ahead) * CELL;
    const arrow = make("g", { class: `arrow ${kind}`, transform: `translate(${x} ${y}) rotate(${ARROWS[action]})` }, this.marks);
    make("path", { d: "M-13 -5.5H1V-12.5L15 0 1 12.5V5.5H-13Z", "stroke-linejoin": "round", "stroke-width": 3.2 }, arrow);
  }
}

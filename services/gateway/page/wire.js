// The connection to the gateway: opened again whenever it is lost, checked by a heartbeat, never a second one.

const QUICK_TRIES = 40;
const WAIT_MS = [250, 1500, 8000]; // first bound, the bound of the first tries, the bound ever after
const QUIET_MS = 4000;
const PONG_MS = 2000;
const CHECK_MS = 500;

export class Wire {
  /** hello() makes the first frame; onFrame(frame) takes what comes; onState("connecting"|"online"|"offline"). */
  constructor(hello, onFrame, onState) {
    this.hello = hello;
    this.onFrame = onFrame;
    this.onState = onState;
    this.socket = null;
    this.tries = 0;
    this.stopped = false;
    this.timer = 0;
    this.heard = 0;
    this.pinged = 0;
    addEventListener("online", () => this.hurry());
    addEventListener("offline", () => this.drop());
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden) this.hurry();
    });
    setInterval(() => this.check(), CHECK_MS);
  }

  open() {
    clearTimeout(this.timer);
    if (this.stopped || this.socket) return;
    this.onState("connecting");
    const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`;
    const socket = new WebSocket(address);
    this.socket = socket;
    this.heard = performance.now();
    this.pinged = 0;
    socket.onopen = () => {
      this.heard = performance.now();
      socket.send(JSON.stringify(this.hello()));
    };
    socket.onmessage = (event) => {
      if (this.socket !== socket) return;
      this.heard = performance.now();
      this.pinged = 0;
      this.take(JSON.parse(event.data));
    };
    socket.onclose = () => {
      if (this.socket === socket) this.drop();
    };
  }

  take(frame) {
    if (frame.type === "you") {
      this.tries = 0;
      this.onState("online");
    }
    if (frame.type === "refused" && frame.final) this.stop();
    if (frame.type !== "pong") this.onFrame(frame);
  }

  /** Send a frame if there is a connection; whoever needs more than that keeps it in the outbox. */
  send(frame) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(typeof frame === "string" ? frame : JSON.stringify(frame));
    return true;
  }

  /** Something was lost, or the network came back: do not wait out the pause. */
  hurry() {
    if (this.stopped) return;
    if (!this.socket) this.open();
    else if (this.socket.readyState === WebSocket.OPEN) this.ping();
  }

  ping() {
    if (!this.pinged && this.send({ type: "ping" })) this.pinged = performance.now();
  }

  check() {
    if (!this.socket || this.stopped) return;
    const now = performance.now();
    const opening = this.socket.readyState !== WebSocket.OPEN;
    if ((this.pinged && now - this.pinged > PONG_MS) || (opening && now - this.heard > QUIET_MS)) this.drop();
    else if (!opening && now - this.heard > QUIET_MS) this.ping();
  }

  drop() {
    const socket = this.socket;
    this.socket = null;
    if (socket) {
      socket.onclose = socket.onmessage = socket.onopen = null;
      socket.close();
    }
    if (this.stopped) return;
    this.onState("offline");
    const bound = this.tries < QUICK_TRIES ? WAIT_MS[1] : WAIT_MS[2];
    const wait = Math.random() * Math.min(bound, WAIT_MS[0] * 2 ** Math.min(this.tries, 10));
    this.tries += 1;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.open(), wait);
  }

  stop() {
    this.stopped = true;
    clearTimeout(this.timer);
  }

  start() {
    this.stopped = false;
    this.socket = null;
    this.tries = 0;
    this.open();
  }
}

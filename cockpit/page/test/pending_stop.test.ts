import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { Session } from "../src/model/session.ts";
import { PendingStop } from "../src/wire/pending_stop.ts";
import { RunLine } from "../src/wire/run_line.ts";

// A tab without a browser: its storage outlasts the pages that are loaded in it.
const stored = new Map<string, string>();
const storage = {
  getItem: (key: string) => stored.get(key) ?? null,
  setItem: (key: string, value: string) => void stored.set(key, value),
  removeItem: (key: string) => void stored.delete(key),
};
let now = 0;
const load = (run = "token") => new PendingStop(run, storage, () => now);

beforeEach(() => {
  stored.clear();
  now = 1_000_000;
});

test("a stop is pending until it is confirmed, also after the page is loaded again", () => {
  const pressed = load().press();
  now += 29_000;
  const page = load();
  assert.equal(page.due(), pressed);
  page.confirm(pressed);
  assert.equal(page.due(), undefined);
  assert.equal(load().due(), undefined);
});

test("a stop of more than 30 s ago is not sent, and that is said once", () => {
  load().press();
  now += 30_001;
  const page = load();
  assert.equal(page.due(), "too old");
  assert.equal(page.due(), undefined);
  assert.equal(load().due(), undefined);
});

test("sending again makes a stop no younger", () => {
  const page = load();
  page.press();
  for (let k = 0; k < 4; ++k, now += 10_000) assert.equal(typeof page.due(), k < 3 ? "number" : "string");
});

test("a stop belongs to its run", () => {
  load().press();
  assert.equal(load("another").due(), undefined);
});

test("the answer to an earlier press does not confirm a later one", () => {
  const page = load();
  const first = page.press();
  now += 1000;
  const second = page.press();
  page.confirm(first);
  assert.equal(page.due(), second);
});

test("what somebody else has stored is no stop, and a tab that stores nothing owes it as long as the page lives", () => {
  for (const text of ["", "null", "{", "[]", '["token"]', '["token","soon"]']) {
    stored.set("multipanda.pending_stop", text);
    assert.equal(load().due(), undefined, text);
  }
  const refuse = () => {
    throw new Error("storage is disabled");
  };
  const page = new PendingStop("token", { getItem: refuse, setItem: refuse, removeItem: refuse }, () => now);
  const pressed = page.press();
  assert.equal(page.due(), pressed);
});

test("a page that is loaded again sends the stop that was not confirmed, also between two runs, and says so", async (t) => {
  t.mock.timers.enable({ apis: ["setInterval", "setTimeout"] });
  const sent: string[] = [];
  class Socket extends EventTarget {
    static readonly OPEN = 1;
    static readonly CLOSED = 3;
    readyState = Socket.OPEN;
    constructor() {
      super();
      queueMicrotask(() => this.dispatchEvent(new Event("open")));
    }
    send(text: string): void {
      const { id, do: word } = JSON.parse(text) as { id: number; do: string };
      sent.push(word);
      const hello = { wire: 1, kind: "none", client: 1, control: null };
      const answer = { id, ok: true, ...(word === "hello" ? { hello } : { no_further_run: true }) };
      queueMicrotask(() => this.dispatchEvent(new MessageEvent("message", { data: JSON.stringify(answer) })));
    }
    close(): void {
      this.readyState = Socket.CLOSED;
      this.dispatchEvent(Object.assign(new Event("close"), { code: 1000, reason: "" }));
    }
  }
  for (const [name, value] of Object.entries({ WebSocket: Socket, sessionStorage: storage }))
    Object.defineProperty(globalThis, name, { value, configurable: true });
  const messages: string[] = [];
  const hooks = { hello: () => {}, plot: () => {}, slice: () => {}, message: (text: string) => messages.push(text) };
  const line = () => new RunLine(new Session(), hooks, "ws://localhost/ws", "token");

  line().stop(); // before there is a connection
  await new Promise(setImmediate);
  assert.match(messages.pop()!, /may not have reached/);
  const again = line();
  again.open();
  await new Promise(setImmediate);
  assert.deepEqual(sent, ["hello", "stop"]);
  assert.deepEqual(messages, [
    "A stop that the run had not confirmed is sent again.",
    "Stopped: no further run is started.",
  ]);
  assert.equal(stored.size, 0);
});

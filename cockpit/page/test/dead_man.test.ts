import assert from "node:assert/strict";
import { test } from "node:test";
import { DeadMan, type Grip } from "../src/safety/dead_man.ts";

function setUp() {
  const said: string[] = [];
  const gate = new DeadMan({ beat: () => said.push("beat"), release: (cause) => said.push(`release: ${cause}`) });
  const grip = (name: string, read: () => boolean = () => true): Grip & { ended: string[] } => {
    const ended: string[] = [];
    return { name, read, released: (cause) => ended.push(cause), ended };
  };
  return { said, gate, grip };
}

test("nothing is said while nothing is held", () => {
  const { said, gate } = setUp();
  for (let now = 0; now < 1000; now += 16) assert.equal(gate.readAll(now), false);
  assert.deepEqual(said, []);
});

test("the first beat is sent by the press, the next ones every 50 ms, the release at once", () => {
  const { said, gate, grip } = setUp();
  const button = grip("button");
  gate.press(button, 1000);
  assert.deepEqual(said, ["beat"]);
  for (let now = 1010; now < 1210; now += 10) gate.readAll(now);
  assert.deepEqual(said, ["beat", "beat", "beat", "beat", "beat"]); // 1000, 1050, 1100, 1150, 1200
  gate.letGo("button", "pointer up");
  assert.deepEqual(said.slice(5), ["release: pointer up"]);
  assert.deepEqual(button.ended, ["pointer up"]);
});

test("a button that reads as released ends the hold in the same reading, without another beat", () => {
  const { said, gate, grip } = setUp();
  let down = true;
  const pad = grip("gamepad", () => down);
  gate.press(pad, 0);
  gate.readAll(60);
  down = false;
  assert.equal(gate.readAll(120), false);
  assert.deepEqual(said, ["beat", "beat", "release: released"]);
  assert.deepEqual(pad.ended, ["released"]);
});

test("after a gap in the readings nobody knows whether the button is still held: everything is let go", () => {
  const { said, gate, grip } = setUp();
  const button = grip("button");
  gate.press(button, 0);
  gate.readAll(150);
  assert.equal(gate.readAll(351), false); // the page was frozen for 201 ms
  assert.deepEqual(said, ["beat", "beat", "release: the page stalled"]);
  assert.deepEqual(button.ended, ["the page stalled"]);
  // A beat needs a new press.
  gate.readAll(360);
  assert.equal(said.length, 3);
});

test("with two grips the arms are released only when the second one is let go", () => {
  const { said, gate, grip } = setUp();
  const [left, right] = [grip("left"), grip("right")];
  gate.press(left, 0);
  gate.press(right, 1);
  gate.letGo("left", "left up");
  assert.deepEqual(left.ended, ["left up"]);
  assert.deepEqual(said, ["beat"]);
  assert.ok(gate.held && gate.holds("right"));
  gate.letGo("right", "right up");
  assert.deepEqual(said, ["beat", "release: right up"]);
});

test("losing the page lets everything go, once", () => {
  const { said, gate, grip } = setUp();
  const grips = [grip("a"), grip("b")];
  for (const one of grips) gate.press(one, 0);
  gate.letGoAll("the tab was hidden");
  gate.letGoAll("the tab was hidden");
  assert.deepEqual(said, ["beat", "release: the tab was hidden"]);
  for (const one of grips) assert.deepEqual(one.ended, ["the tab was hidden"]);
});

test("a seeded sequence never beats while nothing is held, and every hold ends with one release", () => {
  let seed = 7;
  const random = () => (seed = (seed * 48271) % 2147483647) / 2147483647;
  let held = false;
  const gate = new DeadMan({
    beat: () => assert.ok(down.size > 0, "beat while all buttons are up"),
    release: () => (held = false),
  });
  const down = new Map<string, object>(); // the buttons that are down, each with its press
  let now = 0;
  for (let k = 0; k < 20000; ++k) {
    now += random() * 40;
    const name = `grip${Math.floor(random() * 3)}`;
    const what = random();
    if (what < 0.3 && !down.has(name)) {
      const press = {};
      down.set(name, press);
      const lift = () => down.get(name) === press && down.delete(name);
      gate.press({ name, read: () => down.get(name) === press, released: lift }, now);
      held = true;
    } else if (what < 0.4) {
      down.delete(name); // read as released at the next frame
    } else if (what < 0.45) {
      gate.letGoAll("blur");
    } else {
      gate.readAll(now);
      assert.equal(gate.held, down.size > 0);
    }
    if (!gate.held) assert.equal(held, false);
  }
});

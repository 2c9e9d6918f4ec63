import assert from "node:assert/strict";
import { test } from "node:test";
import { Histogram } from "../src/model/histogram.ts";
import { importance, Timeline } from "../src/model/timeline.ts";

test("owners become spans, and a change ends one where the next begins", () => {
  const timeline = new Timeline();
  for (let t = 0; t < 10; ++t) timeline.own("left", t < 4 ? "pose" : "joint", t);
  assert.deepEqual(timeline.spansOf("left"), [
    { from: 0, to: 4, owner: "pose" },
    { from: 4, to: 9, owner: "joint" },
  ]);
  assert.deepEqual(timeline.spansOf("right"), []);
});

test("a time that goes back cuts the spans there", () => {
  const timeline = new Timeline();
  for (let t = 0; t < 10; ++t) timeline.own("left", t < 4 ? "pose" : "joint", t);
  timeline.own("left", "hold", 2);
  assert.deepEqual(timeline.spansOf("left"), [
    { from: 0, to: 2, owner: "pose" },
    { from: 2, to: 2, owner: "hold" },
  ]);
});

test("the newest events are kept", () => {
  const timeline = new Timeline(5);
  for (let k = 0; k < 9; ++k) timeline.add({ t_s: k, cycle: k, kind: "switched", arm: "", text: `${k}` });
  assert.deepEqual(
    timeline.events.map((event) => event.t_s),
    [4, 5, 6, 7, 8],
  );
});

test("what needs attention stands out", () => {
  assert.deepEqual(["error", "switched", "target_set"].map(importance), ["alarming", "notable", "plain"]);
});

test("quantiles of cycle times are bounded by their bin, 21 % apart", () => {
  const counts = new Array<number>(50).fill(0);
  for (let k = 1; k <= 1000; ++k) counts[Histogram.bin(k)]! += 1;
  const histogram = new Histogram(counts);
  for (const share of [0.1, 0.5, 0.99, 1]) {
    const exact = share * 1000;
    const shown = histogram.quantile(share);
    assert.ok(shown >= exact && shown <= exact * 10 ** (1 / 12) + 1e-9, `${share}: ${shown}`);
  }
  assert.equal(histogram.quantile(1), histogram.worst);
  assert.equal(histogram.total, 1000);
  assert.equal(new Histogram().worst, 0);
});

test("every time is in the bin between its edges", () => {
  for (const us of [0.2, 1, 9.99, 10, 123, 9999, 10000, 1e7]) {
    const bin = Histogram.bin(us);
    assert.ok(us >= Histogram.edge(bin) * (1 - 1e-9), `${us}`);
    if (bin < 49) assert.ok(us < Histogram.edge(bin + 1) * (1 + 1e-9), `${us}`);
  }
});

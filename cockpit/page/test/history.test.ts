import assert from "node:assert/strict";
import { test } from "node:test";
import { csv, History } from "../src/model/history.ts";

test("the newest rows are kept, oldest first", () => {
  const history = new History(4);
  history.watch("q", 1);
  for (let k = 0; k < 6; ++k) history.take(k, () => [10 * k]);
  assert.deepEqual(history.columns("q", 9), { t: [2, 3, 4, 5], values: [[20, 30, 40, 50]] });
  assert.deepEqual(history.columns("q", 1), { t: [4, 5], values: [[40, 50]] });
});

test("only watched quantities are kept, until nobody watches them", () => {
  const history = new History(10);
  history.watch("q", 2);
  history.watch("q", 2);
  for (let k = 0; k < 4; ++k) history.take(k, (name) => (name === "q" ? [k, -k] : undefined));
  history.take(3, () => [99, 99]); // the same cycle again
  assert.deepEqual(history.columns("q", 2), {
    t: [1, 2, 3],
    values: [
      [1, 2, 3],
      [-1, -2, -3],
    ],
  });
  assert.deepEqual(history.columns("other", 2), { t: [], values: [] });
  history.unwatch("q");
  assert.deepEqual(history.names(), ["q"]);
  history.unwatch("q");
  assert.deepEqual(history.names(), []);
});

test("rows that come again are not taken twice", () => {
  const history = new History(10);
  history.watch("q", 1);
  for (const t of [1, 2, 3]) history.take(t, () => [t]);
  history.expectRepeats();
  history.watch("new", 1);
  for (const t of [2, 3, 4]) history.take(t, () => [10 * t]);
  assert.deepEqual(history.columns("q", 9), { t: [1, 2, 3, 4], values: [[1, 2, 3, 40]] });
  assert.deepEqual(history.columns("new", 9), { t: [2, 3, 4], values: [[20, 30, 40]] });
});

test("a time that goes back begins again, and short values are filled up", () => {
  const history = new History(10);
  history.watch("q", 2);
  history.take(5, () => [1, 2]);
  history.take(0, () => [3]);
  assert.deepEqual(history.columns("q", 100), { t: [0], values: [[3], [NaN]] });
});

test("a table of comma-separated values", () => {
  assert.equal(
    csv(
      ["t_s", 'a "b", c'],
      [
        [0.001, 0.002],
        [1e-17, NaN],
      ],
    ),
    't_s,"a ""b"", c"\n0.001,1e-17\n0.002,\n',
  );
});

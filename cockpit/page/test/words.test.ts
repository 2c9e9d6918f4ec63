import assert from "node:assert/strict";
import { test } from "node:test";
import { boundsFor } from "../src/panels/parameter_list.ts";
import { rounded, stepFor } from "../src/panels/controls.ts";
import { clock, fixed, listed, withoutUnit } from "../src/ui/words.ts";

test("names carry their unit at their end", () => {
  for (const unit of ["n_per_m", "nm_per_s", "n_nm", "m_per_s2", "nm_per_rad_per_s", "mrad", "us", "m"])
    assert.equal(withoutUnit(`tau_rate_${unit}`), "tau rate");
  assert.equal(withoutUnit("damping_ratio"), "damping ratio");
  assert.equal(withoutUnit("inertia_kg_m2"), "inertia kg m2");
});

test("numbers keep their width, and zero has no sign", () => {
  assert.equal(fixed(-0.0001, 2), "0.00");
  assert.equal(fixed(-1.25, 1), "−1.3");
  assert.equal(fixed(undefined, 2), "–");
  assert.equal(fixed(NaN, 2), "–");
});

test("times and lists", () => {
  assert.equal(clock(123.44), "2:03.4");
  assert.equal(clock(0.3), "0:00.3");
  assert.equal(clock(NaN), "–");
  assert.equal(listed(["left"]), "left");
  assert.equal(listed(["left", "right", "rear"]), "left, right and rear");
});

test("a slider's step is a power of ten of about a thousandth of its span", () => {
  assert.equal(stepFor(3000), 1);
  assert.equal(stepFor(5.8), 0.01);
  assert.equal(stepFor(0), 0.001);
  assert.equal(rounded(0.123456, 0.001), 0.123);
  assert.equal(rounded(123.4, 1), 123);
});

test("a parameter without an upper bound gets one from its value", () => {
  const parameter = { name: "x", value: [10], doc: "", min: 0, max: 1e9 };
  assert.deepEqual(boundsFor(parameter, [10]), { min: 0, max: 40 });
  assert.deepEqual(boundsFor({ ...parameter, max: 5 }, [3]), { min: 0, max: 5 });
});

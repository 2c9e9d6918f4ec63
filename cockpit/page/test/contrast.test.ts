// Text on its background has at least the contrast of WCAG 2.2 AA in both themes: 4.5 to 1, and 3 to 1 for drawings.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

const css = readFileSync("style/tokens.css", "utf8");

function tokens(selector: string): Map<string, string> {
  const block = css.slice(css.indexOf(selector)).match(/\{([^}]*)\}/)?.[1] ?? "";
  return new Map([...block.matchAll(/--([\w-]+):\s*(#[0-9a-f]{6});/g)].map((match) => [match[1]!, match[2]!]));
}

function luminance(color: string): number {
  const [r, g, b] = [1, 3, 5].map((at) => {
    const value = parseInt(color.slice(at, at + 2), 16) / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r! + 0.7152 * g! + 0.0722 * b!;
}

function contrast(a: string, b: string): number {
  const [dark, light] = [luminance(a), luminance(b)].sort((x, y) => x - y);
  return (light! + 0.05) / (dark! + 0.05);
}

const texts = ["text", "muted", "accent", "good", "warning", "bad", "arm-1", "arm-2", "arm-3", "arm-4"];
const grounds = ["background", "surface", "raised", "sunken"];
const pairs: [string, string, number][] = [
  ...texts.flatMap((text) => grounds.map((ground): [string, string, number] => [text, ground, 4.5])),
  ["on-accent", "accent-fill", 4.5],
  ["on-stop", "stop", 4.5],
  ["on-stop", "stop-strong", 4.5],
  ["warning", "warning-fill", 4.5],
  ["text", "warning-fill", 4.5],
  ["bad", "bad-fill", 4.5],
  ["text", "bad-fill", 4.5],
];

test("black on white has the contrast of the standard", () => assert.equal(contrast("#000000", "#ffffff"), 21));

for (const theme of ["dark", "light"]) {
  test(`contrast of the ${theme} theme`, () => {
    const colors = new Map([...tokens(":root {"), ...tokens(`:root[data-theme="${theme}"]`)]);
    for (const [front, back, least] of pairs) {
      const [a, b] = [colors.get(front), colors.get(back)];
      assert.ok(a && b, `${front} or ${back} is missing`);
      assert.ok(contrast(a, b) >= least, `${front} on ${back}: ${contrast(a, b).toFixed(2)} is below ${least}`);
    }
  });
}

// From a state to its picture, and from a drag to the torque that it causes: figures for the docs. They hold for the
// computer that they are measured on; without a graphics card most of both is drawing.
import assert from "node:assert/strict";
import { test } from "node:test";
import { activateAtOnce, gizmoHandle, holding, open, pictures, Run, takeControl, until } from "./support.ts";

const kCount = pictures ? 20 : 4; // of drags; many where pictures and figures are asked for

test("latencies: state to picture, drag to torque", async (t) => {
  const run = await Run.idle("two_arms");
  try {
    const { page, context } = await open(run.url);
    const pictures = await page.evaluate(async (count) => {
      const { session, stage } = window.cockpit;
      const ages: number[] = [];
      let newest = -1;
      // A frame's handlers run before it is drawn: the age is read after the drawing, in the next task.
      stage.beforeFrame.push(() => {
        const { cycle, sent_ms, since_s } = session.state!;
        if (cycle === newest) return;
        newest = cycle;
        stage.touch();
        setTimeout(() => ages.push(Date.now() - sent_ms + 1000 * since_s));
      });
      await new Promise((resolve) => setTimeout(resolve, 250 * count));
      return ages;
    }, kCount);
    print("state to picture", pictures);

    await holding(t, page, "drag to torque", async () => {
      await takeControl(page);
      await watchTorques(page);
      await page.getByRole("tab", { name: "Move" }).click();
      await page.getByRole("checkbox", { name: "Drag the target in the picture" }).check();
      await page.getByRole("button", { name: "Side" }).click();
      const delays: number[] = [];
      for (let tries = 0; tries < 2 * kCount && delays.length < kCount; ++tries) {
        await activateAtOnce(page, "left_cartesian");
        await page.waitForTimeout(500); // at rest
        const [x = NaN, y = NaN] = await gizmoHandle(page);
        await page.mouse.move(x, y);
        await page.mouse.down();
        await page.waitForTimeout(200);
        await page.mouse.move(x, y + (tries % 2 ? -8 : 8));
        await page.waitForTimeout(400);
        await page.mouse.up();
        const delay = await page.evaluate(() => window.delay());
        if (delay !== undefined) delays.push(delay);
      }
      print("drag to torque", delays);
    });
    await context.close();
  } finally {
    await run.end();
  }
});

function print(what: string, values: number[]): void {
  assert.ok(values.length >= kCount / 2, `${what}: only ${values.length} values`);
  const sorted = [...values].sort((a, b) => a - b);
  const at = (share: number) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))]!.toFixed(0);
  console.log(`${what}: median ${at(0.5)} ms, 99 % ${at(0.99)} ms, ${sorted.length} values`);
  assert.ok(Number(at(0.5)) > 0 && Number(at(0.5)) < 2000);
}

declare global {
  interface Window {
    /** From the newest move of the mouse to the first cycle with another torque [ms]. */
    delay(): number | undefined;
  }
}

/** A connection of its own reads the torques of every cycle. */
async function watchTorques(page: Parameters<typeof takeControl>[0]): Promise<void> {
  await page.evaluate(() => {
    const socket = new WebSocket(`ws://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    const say = (message: object) => socket.send(JSON.stringify(message));
    socket.onopen = () => {
      say({ do: "hello", id: 1, token: location.hash.slice(1) });
      say({ do: "plot", id: 2, fields: ["cycle", "start_ns", "left/tau_J_d_nm"] });
    };
    let rows: number[][] = [];
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") return;
      const head = new Uint32Array(data, 0, 4);
      if (head[0] !== 2) return;
      const numbers = new Float64Array(data, 16);
      for (let row = 0; row < head[2]!; ++row) rows.push([...numbers.subarray(10 * row, 10 * (row + 1))]);
      rows = rows.slice(-4000);
    };
    let moved = 0;
    addEventListener("pointermove", (event) => (moved = performance.timeOrigin + event.timeStamp), { capture: true });
    // The computer's two clocks: that of cycles and that of pages.
    const { session } = window.cockpit;
    const clocks = () => {
      const { cycle, sent_ms, since_s } = session.state!;
      const row = rows.find((row) => row[1] === cycle);
      return row && sent_ms - 1000 * since_s - 1e-6 * row[2]!;
    };
    window.delay = () => {
      const offset = clocks();
      if (offset === undefined) return undefined;
      const at = (row: number[]) => offset + 1e-6 * row[2]!;
      const first = rows.findIndex((row) => at(row) >= moved);
      if (first < 1) return undefined;
      const torques = rows[first - 1]!.slice(3);
      const changed = rows
        .slice(first)
        .find((row) => row.slice(3).some((tau, k) => Math.abs(tau - torques[k]!) > 5e-3));
      return changed && at(changed) - moved;
    };
  });
  await until(page, () => window.delay !== undefined);
}

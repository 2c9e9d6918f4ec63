// Starts the page: the token from the address, the connection, and the regions.
import { App } from "./app.ts";
import { LogMode } from "./log_mode.ts";
import { Session } from "./model/session.ts";
import { LogPanel } from "./panels/log_panel.ts";
import type { FieldList } from "./wire/binary.ts";
import { RunLine } from "./wire/run_line.ts";

const session = new Session();
const logPanel = new LogPanel();
const token = location.hash.slice(1);
const url = `ws://${location.host}/ws`;

const line = new RunLine(
  session,
  {
    hello: (hello) => {
      app.offer(hello.record_fields.map(([name, size]) => ({ name, size })));
      app.setMode(hello.kind);
      if (hello.kind === "log") logMode.begin(hello);
    },
    plot: (columns, rows, numbers) => takeRows(columns, rows, numbers),
    slice: (slice) => logMode.take(slice),
    message: (text) => app.toasts.show(text),
  },
  url,
  token,
);
const app = new App(session, line, { title: "Log", panel: logPanel.element }, async (names) => {
  if (session.kind !== "log") {
    app.history.expectRepeats();
    return line.watch(names);
  }
  const found = await logMode.columns(names);
  if (!found) return;
  app.history.clear();
  takeRows(found.columns, found.rows, found.numbers);
});
const logMode = new LogMode(app, logPanel);

// Rows of numbers, the time first, into the history of the plotted quantities.
function takeRows(columns: FieldList, rows: number, numbers: Float64Array): void {
  const width = 1 + columns.reduce((sum, [, count]) => sum + count, 0);
  if (numbers.length !== rows * width) return;
  const places = new Map<string, [number, number]>();
  let offset = 1;
  for (const [name, count] of columns) {
    places.set(name, [offset, offset + count]);
    offset += count;
  }
  for (let row = 0; row < rows; ++row) {
    const values = numbers.subarray(row * width, (row + 1) * width);
    app.history.take(values[0]!, (name) => {
      const place = places.get(name);
      return place && values.subarray(...place);
    });
  }
}

app.frames.push((seconds) => logMode.frame(seconds));
setInterval(() => {
  if (session.status !== "connected" || session.kind === "log") return;
  if (!app.isLoopShown()) return;
  void line.histogram().then((histogram) => histogram && app.loop.take(histogram));
}, 1000);
line.open();

// For tests and latency measurements.
const cockpit = { session, line, stage: app.view.stage, held: () => app.holding.held };
declare global {
  interface Window {
    cockpit: typeof cockpit;
  }
}
window.cockpit = cockpit;

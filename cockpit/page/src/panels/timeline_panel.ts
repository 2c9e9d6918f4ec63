// History of the run: a lane per arm in the colors of its owners, and the events as a text list.
import type { Session } from "../model/session.ts";
import { importance, Timeline, type TimelineEvent } from "../model/timeline.ts";
import { div, h, replaceChildren } from "../ui/dom.ts";
import type { ThemeSwitch } from "../ui/theme.ts";
import { clock, spaced } from "../ui/words.ts";

const kWindow = 60; // [s]
const kRows = 200;
const kLane = 22;

export class TimelinePanel {
  readonly element: HTMLElement;
  readonly timeline = new Timeline();
  private readonly canvas = h("canvas", {
    class: "lanes",
    role: "img",
    "aria-label": "Owners of the arms over the last minute",
  });
  private readonly rows = h("tbody", {});
  private drawn = 0;

  constructor(
    private readonly session: Session,
    private readonly theme: ThemeSwitch,
  ) {
    const heads = ["Time", "Event", "Arm", "What"].map((text) => h("th", { scope: "col" }, text));
    const table = h("table", {}, h("thead", {}, h("tr", {}, ...heads)), this.rows);
    const region = { class: "events", role: "region", tabindex: 0, "aria-label": "Events" };
    this.element = div("timeline", this.canvas, h("div", region, table));
    session.on("event", (event) => this.add(event));
    session.on("state", (state) => {
      session.scene?.arms.forEach((arm, k) => this.timeline.own(arm.name, state.arms[k]?.controllet ?? "", state.t_s));
    });
    session.on("scene", () => {
      this.timeline.clear();
      replaceChildren(this.rows);
    });
  }

  update(): void {
    const now = performance.now();
    if (now - this.drawn < 200 || this.canvas.clientWidth === 0) return;
    this.drawn = now;
    this.draw();
  }

  private add(event: TimelineEvent): void {
    this.timeline.add(event);
    // The text begins with the new owner's name, so that lanes also show the time before this page opened.
    if (event.kind === "controllet") this.timeline.own(event.arm, event.text.split(" ")[0]!, event.t_s);
    if (importance(event.kind) === "plain") return;
    const words = [spaced(event.kind), event.arm, event.text].map((text) => h("td", {}, text));
    const at = h("td", { class: "number" }, clock(event.t_s));
    this.rows.prepend(h("tr", { class: importance(event.kind) }, at, ...words));
    while (this.rows.childElementCount > kRows) this.rows.lastElementChild!.remove();
  }

  private draw(): void {
    const { scene, state } = this.session;
    if (!scene || !state) return;
    const ratio = devicePixelRatio;
    const [width, height] = [this.canvas.clientWidth, scene.arms.length * kLane + 18];
    this.canvas.style.height = `${height}px`;
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    const pen = this.canvas.getContext("2d")!;
    pen.scale(ratio, ratio);
    pen.font = "11px sans-serif";
    pen.textBaseline = "middle";
    const left = 8 + Math.max(...scene.arms.map((arm) => pen.measureText(arm.name).width)) + 8;
    const from = Math.max(0, state.t_s - kWindow);
    const x = (t: number) => left + ((t - from) / kWindow) * (width - left - 6);
    scene.arms.forEach((arm, k) => this.lane(pen, arm.name, k, x, from));
    pen.fillStyle = this.theme.color("muted");
    const every = x(10) - x(0) < 40 ? 30 : 10; // so that the labels have room
    for (let t = Math.ceil(from / every) * every; t <= from + kWindow; t += every) {
      pen.fillRect(x(t), height - 16, 1, 4);
      if (x(t) + 30 < width) pen.fillText(`${t} s`, x(t) + 3, height - 8);
    }
    for (const event of this.timeline.events) {
      const kind = importance(event.kind);
      if (event.t_s < from || kind === "plain") continue;
      const lane = scene.arms.findIndex((arm) => arm.name === event.arm);
      pen.fillStyle = this.theme.color(kind === "alarming" ? "bad" : "text");
      const [top, tall] = lane < 0 ? [0, scene.arms.length * kLane] : [lane * kLane, kLane];
      pen.fillRect(x(event.t_s) - 1, top + 1, 2, tall - 3);
    }
  }

  private lane(pen: CanvasRenderingContext2D, arm: string, k: number, x: (t: number) => number, from: number): void {
    const middle = k * kLane + kLane / 2;
    pen.fillStyle = this.theme.color("text");
    pen.fillText(arm, 8, middle);
    this.timeline.spansOf(arm).forEach((span, i) => {
      if (span.to < from) return;
      const [a, b] = [x(Math.max(from, span.from)), x(span.to)];
      pen.fillStyle = this.theme.color(`arm-${(k % 4) + 1}`);
      pen.globalAlpha = i % 2 === 0 ? 0.32 : 0.18;
      pen.fillRect(a, middle - 8, Math.max(1, b - a), 16);
      pen.globalAlpha = 1;
      pen.fillStyle = this.theme.color("text");
      const text = span.owner || "held";
      if (pen.measureText(text).width < b - a - 8) pen.fillText(text, a + 4, middle + 1);
    });
  }
}

// The bar: scene, status of the run, control, and Stop, which is always visible and allowed.
import type { Session } from "../model/session.ts";
import { button, div, h, replaceChildren, setAttribute, setText, toggle, icon } from "../ui/dom.ts";
import type { ThemeSwitch } from "../ui/theme.ts";
import { clock, fixed } from "../ui/words.ts";

export const kStopKey = "Escape";

export class Bar {
  readonly element: HTMLElement;
  readonly stop: HTMLButtonElement;
  private readonly title = h("h1", {}, "multipanda");
  private readonly subtitle = h("p", {});
  private readonly line = h("span", { class: "badge", role: "status" }, "connecting");
  private readonly time = h("span", { class: "number wide", title: "Time of the run" });
  private readonly loop = h("span", { class: "badge wide" });
  private readonly people = h("span", { class: "badge wide" });
  private readonly control = h("div", { class: "row control", role: "group", "aria-label": "Control" });
  private shownControl = "";

  constructor(
    private readonly session: Session,
    theme: ThemeSwitch,
    private readonly stopAll: () => void,
  ) {
    const title = "Stops all arms at once. Key: Escape";
    const how = { class: "stop", "aria-keyshortcuts": kStopKey, title };
    this.stop = button([icon("stop", 18), "Stop"], undefined, how);
    // On press, not on release: a stop must not wait.
    this.stop.addEventListener("pointerdown", () => this.stopAll());
    this.stop.addEventListener("click", (event) => {
      if (event.detail === 0) this.stopAll(); // from the keyboard or a screen reader
    });
    const onKey = (event: KeyboardEvent) => event.key === kStopKey && !event.repeat && this.stopAll();
    addEventListener("keydown", onKey, { capture: true });
    const shade = button("", () => theme.switchOver(), { class: "quiet icon-only" });
    const showTheme = () => {
      setAttribute(shade, "aria-label", theme.theme === "dark" ? "Use the light theme" : "Use the dark theme");
      replaceChildren(shade, icon(theme.theme === "dark" ? "sun" : "moon", 18));
    };
    theme.addEventListener("change", showTheme);
    showTheme();
    this.element = h(
      "header",
      { class: "bar" },
      div("brand", this.title, this.subtitle),
      this.line,
      this.loop,
      this.time,
      h("span", { class: "space" }),
      this.people,
      this.control,
      shade,
      this.stop,
    );
    session.on("scene", (scene) => {
      setText(this.title, scene.name);
      setText(this.subtitle, scene.description || "multipanda");
      document.title = `${scene.name} · multipanda`;
    });
    session.on("status", () => this.showLine());
    session.on("control", () => this.showControl());
    this.showLine();
    this.showControl();
  }

  /** A few times a second. */
  update(): void {
    const { state } = this.session;
    if (!state) return;
    setText(this.time, `${clock(state.t_s)}${state.paused ? " paused" : ""}`);
    setText(this.loop, `${fixed(state.rate_hz, 0)} Hz · ${fixed(state.cycle_us, 0)} µs`);
    this.loop.title = `Cycles per second, computing time of the newest cycle; ${state.overruns} overruns`;
    toggle(this.loop, "warning", state.rate_hz > 0 && state.rate_hz < 950 && !state.paused);
    this.showLine();
    this.showControl();
  }

  private showLine(): void {
    const { status, state, arrived, why } = this.session;
    const old = status === "connected" && state !== undefined && performance.now() - arrived > 1000 && !state.paused;
    const text = old ? "no news" : status === "connected" ? "live" : status;
    setText(this.line, text);
    this.line.title = why;
    toggle(this.line, "good", status === "connected" && !old);
    toggle(this.line, "warning", status === "connecting" || old);
    toggle(this.line, "bad", status === "lost" || status === "refused");
  }

  private showControl(): void {
    const { control, state, status } = this.session;
    const stopped = (state?.arms ?? []).some((arm) => arm.stopped);
    const key = JSON.stringify([control, stopped, status]);
    if (key === this.shownControl) return;
    this.shownControl = key;
    setText(this.people, control.watchers === 1 ? "1 page" : `${control.watchers} pages`);
    this.people.title = "Pages that watch this run";
    const badge = (text: string, kind = "") => h("span", { class: `badge ${kind}` }, text);
    // A stop that this page has not shown is not resumed.
    const seen = (word: string) => word === "resume" && { stops: this.session.state?.stops };
    const ask = (text: string, fields: Record<string, unknown>, kind = "", word = "control") =>
      button(text, () => void this.session.request(word, { ...fields, ...seen(word) }), {
        class: kind,
        disabled: status !== "connected",
      });
    const asking = control.requests[0];
    const shown: (HTMLElement | false)[] = control.mine
      ? [
          stopped && ask("Resume", { arms: "all" }, "primary", "resume"),
          asking !== undefined && ask("Hand over", { give: asking }, "primary"),
          asking !== undefined && ask("Keep", { keep: true }),
          badge("in control", "good"),
          ask("Give up control", { give: null }),
        ]
      : [
          badge("watching"),
          control.taken && control.asked
            ? badge("asked for control", "warning")
            : ask(control.taken ? "Ask for control" : "Take control", { take: true }, control.taken ? "" : "primary"),
        ];
    replaceChildren(this.control, ...shown);
  }
}

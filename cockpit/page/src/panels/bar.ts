// The bar: which scene, how the run does, who has control, and Stop, which is always there and always allowed.
import type { Session } from "../model/session.ts";
import { h, replaceChildren, setAttribute, setText, toggle } from "../ui/dom.ts";
import { icon } from "../ui/icons.ts";
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
    this.stop = h(
      "button",
      { type: "button", class: "stop", "aria-keyshortcuts": kStopKey, title: "Stops all arms at once. Key: Escape" },
      icon("stop", 18),
      "Stop",
    );
    // At the press, not at the release: a stop never waits for a finger.
    this.stop.addEventListener("pointerdown", () => this.stopAll());
    this.stop.addEventListener("click", (event) => {
      if (event.detail === 0) this.stopAll(); // from the keyboard or a screen reader
    });
    addEventListener(
      "keydown",
      (event) => {
        if (event.key === kStopKey && !event.repeat) this.stopAll();
      },
      { capture: true },
    );
    const shade = h("button", { type: "button", class: "quiet icon-only" });
    const showTheme = () => {
      setAttribute(shade, "aria-label", theme.theme === "dark" ? "Use the light theme" : "Use the dark theme");
      replaceChildren(shade, icon(theme.theme === "dark" ? "sun" : "moon", 18));
    };
    shade.addEventListener("click", () => theme.switchOver());
    theme.addEventListener("change", showTheme);
    showTheme();
    this.element = h(
      "header",
      { class: "bar" },
      h("div", { class: "brand" }, this.title, this.subtitle),
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
    const button = (text: string, kind: string, act: () => void) => {
      const element = h("button", { type: "button", class: kind, disabled: status !== "connected" }, text);
      element.addEventListener("click", act);
      return element;
    };
    const ask = (fields: Record<string, unknown>) => () => void this.session.request("control", fields);
    const buttons: HTMLElement[] = [];
    if (control.mine) {
      if (stopped)
        buttons.push(button("Resume", "primary", () => void this.session.request("resume", { arms: "all" })));
      const asking = control.requests[0];
      if (asking !== undefined) {
        buttons.push(button("Hand over", "primary", ask({ give: asking })), button("Keep", "", ask({ keep: true })));
      }
      buttons.push(
        h("span", { class: "badge good" }, "in control"),
        button("Give up control", "", ask({ give: null })),
      );
    } else if (control.taken) {
      buttons.push(
        h("span", { class: "badge" }, "watching"),
        control.asked
          ? h("span", { class: "badge warning" }, "asked for control")
          : button("Ask for control", "", ask({ take: true })),
      );
    } else {
      buttons.push(h("span", { class: "badge" }, "watching"), button("Take control", "primary", ask({ take: true })));
    }
    replaceChildren(this.control, ...buttons);
  }
}

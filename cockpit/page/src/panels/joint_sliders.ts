// Joint positions by sliders: a joint moves while its slider is held, and stops when released.
import type { ArmInfo, ArmState } from "../model/live.ts";
import type { Session } from "../model/session.ts";
import { endingWith, type Holding } from "../safety/holding.ts";
import { JointMotion, type JogSettings } from "../teleop/motions.ts";
import { h, replaceChildren } from "../ui/dom.ts";
import { Slider } from "./controls.ts";

export class JointSliders {
  readonly element = h("div", { class: "joint-sliders" });
  private sliders: Slider[] = [];
  private built = "";

  constructor(
    private readonly session: Session,
    private readonly holding: Holding,
    private readonly settings: () => JogSettings,
  ) {}

  build(arm: ArmInfo): void {
    if (this.built === arm.name) return;
    this.built = arm.name;
    this.sliders = Array.from({ length: arm.joints }, (_, k) => {
      const slider = new Slider({
        label: `Joint ${k + 1}`,
        unit: "rad",
        min: Math.ceil(100 * (arm.q_min_rad[k] ?? -Math.PI)) / 100,
        max: Math.floor(100 * (arm.q_max_rad[k] ?? Math.PI)) / 100,
        step: 0.01,
        value: 0,
        hint: "Moves while it is held",
      });
      // A typed number would cause motion without a held button.
      slider.number.readOnly = true;
      slider.number.tabIndex = -1;
      this.bind(slider, k, arm.name);
      return slider;
    });
    replaceChildren(this.element, ...this.sliders.map((slider) => slider.element));
  }

  update(state: ArmState): void {
    this.sliders.forEach((slider, k) => {
      if (!this.holding.holds(`joint ${k + 1}`)) slider.follow(state.q[k] ?? 0, true);
    });
  }

  private bind(slider: Slider, k: number, arm: string): void {
    const name = `joint ${k + 1}`;
    const { range } = slider;
    let held: "pointer" | "key" | undefined;
    const goal = () => {
      const q = Array.from(this.session.state?.arms[this.session.armIndex(arm)]?.q ?? []);
      const set = this.session.inputFor(arm, "joints");
      const now = set && this.session.reference(set.controllet.name, set.input.name);
      return Array.from(now && Number.isFinite(now[0]!) ? now : q, (value, i) => (i === k ? slider.value : value));
    };
    const motion = endingWith(new JointMotion(this.session, () => arm, this.settings, goal), () => {
      held = undefined;
      slider.release();
    });
    const begin = (by: "pointer" | "key") => {
      held = by;
      if (!this.holding.begin(name, () => held === by && document.activeElement === range, motion)) held = undefined;
    };
    range.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return; // it opens a menu, and its release may not be reported
      range.focus();
      begin("pointer");
    });
    // The browser drags the slider, so the release may be anywhere.
    addEventListener("pointerup", () => held === "pointer" && this.holding.letGo(name));
    addEventListener(
      "pointercancel",
      () => held === "pointer" && this.holding.letGo(name, "the browser took the pointer"),
    );
    range.addEventListener("keydown", (event) => {
      if (/^(Arrow|Page|Home|End)/.test(event.key) && !event.repeat && !event.metaKey && !held) begin("key");
    });
    range.addEventListener("keyup", () => held === "key" && this.holding.letGo(name));
    range.addEventListener("blur", () => this.holding.letGo(name, "the slider lost the focus"));
  }
}

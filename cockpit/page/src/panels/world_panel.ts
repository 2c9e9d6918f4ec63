// Simulation and recording: pause, step, reset; placing and pushing of objects; marking of episodes.
import type { Session } from "../model/session.ts";
import type { Holding } from "../safety/holding.ts";
import { outcome } from "../model/description.ts";
import { button, choice, div, h, newId, replaceChildren, row, section, setText, icon } from "../ui/dom.ts";
import { poseAt } from "../model/live.ts";
import { Slider } from "./controls.ts";

// After a step the world looks as if it were running: its time has just moved. [ms]
const kAfterStep = 500;

export class WorldPanel {
  readonly element = h("div", {});
  private readonly simulation = h("div", {});
  private readonly pause = button("", () => {
    this.stepped = -Infinity;
    void this.session.request("pause", { paused: !this.paused });
  });
  private readonly episode = h("p", { class: "hint", role: "status" }, "No episode has begun.");
  private readonly controls: HTMLFieldSetElement;
  private paused = false; // as shown by the button
  private stepped = -Infinity; // when
  private object = "";
  private follow: () => void = () => {};

  constructor(
    private readonly session: Session,
    private readonly holding: Holding,
  ) {
    this.controls = h(
      "fieldset",
      { class: "plain", disabled: true },
      h("legend", { class: "visually-hidden" }, "Simulation and record"),
      this.simulation,
      this.episodes(),
    );
    this.element.append(this.controls);
    session.on("scene", () => this.build());
    session.on("control", (control) => (this.controls.disabled = !control.mine));
    session.on("state", (state) => {
      this.showPause(state.paused);
      this.follow();
    });
    this.showPause(false);
  }

  private showPause(stands: boolean): void {
    const paused = stands || performance.now() - this.stepped < kAfterStep;
    this.paused = paused;
    const label = paused ? "Continue simulation" : "Pause simulation";
    if (this.pause.getAttribute("aria-label") === label) return;
    this.pause.setAttribute("aria-label", label);
    replaceChildren(this.pause, icon(paused ? "play" : "pause"), paused ? "Continue" : "Pause");
  }

  private build(): void {
    const { scene } = this.session;
    if (!scene?.simulated) {
      replaceChildren(
        this.simulation,
        h("p", { class: "hint" }, "These arms are real: there is no simulation to pause."),
      );
      return;
    }
    const step = () => {
      // Only a paused world steps.
      const note = () => this.paused && (this.stepped = performance.now());
      note();
      void this.session.request("step", { periods: 10 }).then(note);
    };
    const steps = button([icon("step"), "10 ms"], step, { "aria-label": "Step 10 ms" });
    const reset = button([icon("reset"), "Reset"], () => void this.session.request("reset"), {
      "aria-label": "Reset simulation",
    });
    replaceChildren(
      this.simulation,
      section("Simulation", row(...(this.session.commands.has("pause") ? [this.pause, steps] : []), reset)),
      this.objects(scene.bodies.filter((body) => body.movable).map((body) => body.name)),
    );
  }

  private objects(names: string[]): HTMLElement | null {
    if (names.length === 0) return null;
    this.object = names[0]!;
    const id = newId("object");
    const span = { unit: "m", max: 1.2, step: 0.005, value: 0, stays: true };
    const sliders = ["x", "y", "z"].map((label) => new Slider({ label, min: label === "z" ? 0 : -1.2, ...span }));
    const release = () => sliders.forEach((slider) => slider.release());
    const follow = () => {
      const k = this.session.scene!.bodies.findIndex((body) => body.name === this.object);
      const live = this.session.state && poseAt(this.session.state.bodies, 7 * k).position;
      const at = live && Number.isFinite(live[0]) ? live : this.session.scene!.bodies[k]!.pose.position;
      sliders.forEach((slider, axis) => slider.follow(at[axis]!));
    };
    this.follow = follow;
    const choose = (name: string) => {
      this.object = name;
      release();
      follow();
    };
    const place = () => {
      const position_m = sliders.map((slider) => slider.value);
      void this.session.request("place_object", { object: this.object, position_m });
      release();
    };
    return section(
      "Objects",
      row(h("label", { for: id }, "Object"), choice(names, this.object, choose, { id, class: "fill" })),
      ...sliders.map((slider) => slider.element),
      button("Place object", place),
      this.push(),
    );
  }

  // An object is pushed while the button is held, like every motion.
  private push(): HTMLElement {
    const force = new Slider({ label: "Push", unit: "N", min: 1, max: 30, step: 1, value: 5 });
    const way = (text: string, label: string, direction: number[]) => {
      const element = button(text, undefined, { class: "hold", "aria-label": `${label} while held` });
      this.holding.bindButton(element, label, {
        begin: () => (this.session.control.mine ? undefined : "Take control first."),
        step: () => {
          const force_n = direction.map((value) => value * force.value);
          this.session.send({ do: "push_object", object: this.object, force_n });
          return undefined;
        },
        end: () => {},
      });
      return element;
    };
    return div(
      "",
      force.element,
      row(
        way("along x", "Push along x", [1, 0, 0]),
        way("against x", "Push against x", [-1, 0, 0]),
        way("along y", "Push along y", [0, 1, 0]),
        way("against y", "Push against y", [0, -1, 0]),
        way("up", "Push up", [0, 0, 1]),
      ),
    );
  }

  private episodes(): HTMLElement {
    const marked = (text: string, mark: string) => {
      const ask = () =>
        void this.session.request("episode", { mark }).then((answer) => {
          setText(this.episode, outcome(answer, `Episode ${answer["episode"]}: ${mark}.`));
        });
      return button(text, ask, { "aria-label": `Episode: ${mark}` });
    };
    const marks = ["Start", "Success", "Failure", "Discard"].map((text) => marked(text, text.toLowerCase()));
    return section("Episodes", row(...marks), this.episode);
  }
}

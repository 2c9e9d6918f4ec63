// The simulation and the record: pause, step, reset; objects placed and pushed; episodes marked.
import type { Session } from "../model/session.ts";
import type { Holding } from "../safety/holding.ts";
import { h, newId, replaceChildren, setText } from "../ui/dom.ts";
import { icon } from "../ui/icons.ts";
import { poseAt } from "../model/live.ts";
import { Slider } from "./slider.ts";

// After a step the world looks as if it ran: its time has just moved. [ms]
const kAfterStep = 500;

export class WorldPanel {
  readonly element = h("div", {});
  private readonly simulation = h("div", {});
  private readonly pause = h("button", { type: "button" });
  private readonly episode = h("p", { class: "hint", role: "status" }, "No episode has begun.");
  private readonly controls: HTMLFieldSetElement;
  private paused = false; // as the button says
  private stepped = -Infinity; // when
  private object = "";
  private follow: () => void = () => {};

  constructor(
    private readonly session: Session,
    private readonly holding: Holding,
  ) {
    this.pause.addEventListener("click", () => {
      this.stepped = -Infinity;
      void session.request("pause", { paused: !this.paused });
    });
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
    const step = h("button", { type: "button", "aria-label": "Step 10 ms" }, icon("step"), "10 ms");
    step.addEventListener("click", () => {
      // Only a paused world steps.
      const note = () => this.paused && (this.stepped = performance.now());
      note();
      void this.session.request("step", { periods: 10 }).then(note);
    });
    const reset = h("button", { type: "button", "aria-label": "Reset simulation" }, icon("reset"), "Reset");
    reset.addEventListener("click", () => void this.session.request("reset"));
    replaceChildren(
      this.simulation,
      h(
        "div",
        { class: "section" },
        h("h2", {}, "Simulation"),
        h("div", { class: "row" }, ...(this.session.commands.has("pause") ? [this.pause, step] : []), reset),
      ),
      this.objects(scene.bodies.filter((body) => body.movable).map((body) => body.name)),
    );
  }

  private objects(names: string[]): HTMLElement | null {
    if (names.length === 0) return null;
    this.object = names[0]!;
    const id = newId("object");
    const select = h("select", { id, class: "fill" });
    for (const name of names) select.append(h("option", { value: name }, name));
    const sliders = ["x", "y", "z"].map(
      (axis) =>
        new Slider({
          label: axis,
          unit: "m",
          min: axis === "z" ? 0 : -1.2,
          max: 1.2,
          step: 0.005,
          value: 0,
          stays: true,
        }),
    );
    const follow = () => {
      const k = this.session.scene!.bodies.findIndex((body) => body.name === this.object);
      const live = this.session.state && poseAt(this.session.state.bodies, 7 * k).position;
      const at = live && Number.isFinite(live[0]) ? live : this.session.scene!.bodies[k]!.pose.position;
      sliders.forEach((slider, axis) => slider.follow(at[axis]!));
    };
    select.addEventListener("change", () => {
      this.object = select.value;
      for (const slider of sliders) slider.release();
      follow();
    });
    this.follow = follow;
    const place = h("button", { type: "button" }, "Place object");
    place.addEventListener("click", () => {
      void this.session.request("place_object", {
        object: this.object,
        position_m: sliders.map((slider) => slider.value),
      });
      for (const slider of sliders) slider.release();
    });
    return h(
      "div",
      { class: "section" },
      h("h2", {}, "Objects"),
      h("div", { class: "row" }, h("label", { for: id }, "Object"), select),
      ...sliders.map((slider) => slider.element),
      place,
      this.push(),
    );
  }

  // An object is pushed while the button is held, like everything that moves.
  private push(): HTMLElement {
    const force = new Slider({ label: "Push", unit: "N", min: 1, max: 30, step: 1, value: 5 });
    const way = (text: string, label: string, direction: number[]) => {
      const button = h("button", { type: "button", class: "hold", "aria-label": `${label} while held` }, text);
      this.holding.bindButton(button, label, {
        begin: () => (this.session.control.mine ? undefined : "Take control first."),
        step: () => {
          const force_n = direction.map((value) => value * force.value);
          this.session.send({ do: "push_object", object: this.object, force_n });
        },
        end: () => {},
      });
      return button;
    };
    return h(
      "div",
      {},
      force.element,
      h(
        "div",
        { class: "row" },
        way("along x", "Push along x", [1, 0, 0]),
        way("against x", "Push against x", [-1, 0, 0]),
        way("along y", "Push along y", [0, 1, 0]),
        way("against y", "Push against y", [0, -1, 0]),
        way("up", "Push up", [0, 0, 1]),
      ),
    );
  }

  private episodes(): HTMLElement {
    const mark = (text: string, mark: string) => {
      const button = h("button", { type: "button", "aria-label": `Episode: ${mark}` }, text);
      button.addEventListener("click", () => {
        void this.session.request("episode", { mark }).then((answer) => {
          setText(this.episode, answer.ok ? `Episode ${answer["episode"]}: ${mark}.` : `Refused: ${answer.reason}`);
        });
      });
      return button;
    };
    return h(
      "div",
      { class: "section" },
      h("h2", {}, "Episodes"),
      h(
        "div",
        { class: "row" },
        mark("Start", "start"),
        mark("Success", "success"),
        mark("Failure", "failure"),
        mark("Discard", "discard"),
      ),
      this.episode,
    );
  }
}

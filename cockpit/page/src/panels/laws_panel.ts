// Control laws: owner of each arm, alternatives, features and parameters, and the cost of a switch.
import { outcome, type ControlletInfo, type SwitchAnswer } from "../model/description.ts";
import type { Session } from "../model/session.ts";
import type { Holding } from "../safety/holding.ts";
import { button, div, h, replaceChildren, row } from "../ui/dom.ts";
import { fixed, listed, spaced } from "../ui/words.ts";
import { holdButton, isHeldIn } from "./controls.ts";
import { parameterList, type Drafts } from "./parameter_list.ts";

export class LawsPanel {
  readonly element = h("div", {});
  private readonly groups = div("section");
  private readonly result = h("p", { class: "hint", role: "status" });
  private readonly details = div("section");
  private readonly drafts: Drafts = new Map();
  private chosen = "";
  private shown = "";

  constructor(
    private readonly session: Session,
    private readonly holding: Holding,
  ) {
    this.element.append(this.groups, this.details);
    session.on("list", () => this.update());
    session.on("control", () => this.update());
    session.on("scene", () => {
      this.chosen = this.shown = "";
      this.drafts.clear();
      this.update();
    });
  }

  /** Also called with every state, because an arm's owner may change without a request. */
  update(): void {
    const active = this.session.list.map((one) => this.isActive(one));
    const key = JSON.stringify([this.session.list, active, this.session.control.mine, this.chosen]);
    if (key === this.shown || isHeldIn(this.element)) return;
    this.shown = key;
    const focused = document.activeElement?.id;
    this.buildGroups();
    this.buildDetails();
    if (focused) document.getElementById(focused)?.focus();
  }

  private isActive(one: ControlletInfo): boolean {
    const arms = this.session.state?.arms;
    return arms ? arms.some((arm) => arm.controllet === one.name) : one.active;
  }

  private buildGroups(): void {
    const byArms = new Map<string, ControlletInfo[]>();
    for (const one of this.session.list) {
      const key = listed(one.arms);
      byArms.set(key, [...(byArms.get(key) ?? []), one]);
    }
    const sections = [...byArms].map(([arms, controllets]) =>
      h(
        "div",
        { class: "laws", role: "group", "aria-label": `Controllets of ${arms}` },
        h("h3", {}, arms),
        ...controllets.map((one) => this.entry(one)),
      ),
    );
    replaceChildren(this.groups, h("h2", {}, "Controllets"), ...sections, this.result);
  }

  private entry(one: ControlletInfo): HTMLElement {
    const active = this.isActive(one);
    const chosen = one.name === this.chosenController()?.name;
    const choose = () => {
      this.chosen = one.name;
      this.update();
    };
    const names = [h("span", { class: "law-title" }, one.name), h("span", { class: "law-type" }, spaced(one.type))];
    const pressed = { class: "quiet fill law-name", "aria-pressed": String(chosen) };
    return div(
      `row law ${active ? "active" : ""}`,
      button(names, choose, { id: `choose-${one.name}`, ...pressed }),
      holdButton(this.holding, active ? "Active" : "Activate", () => this.activate(one), {
        id: `switch-${one.name}`,
        disabled: !this.session.control.mine || active,
        "aria-label": active ? `${one.name} is active` : `Activate ${one.name} while held`,
      }),
    );
  }

  private async activate(one: ControlletInfo): Promise<SwitchAnswer> {
    const answer = (await this.session.request("switch", { activate: [one.name] })) as SwitchAnswer;
    this.result.textContent = outcome(answer, switchText(answer));
    if (answer.ok) this.chosen = one.name;
    this.update();
    return answer;
  }

  private chosenController(): ControlletInfo | undefined {
    return this.session.controllet(this.chosen) ?? this.session.list.find((one) => this.isActive(one));
  }

  private buildDetails(): void {
    const one = this.chosenController();
    if (!one) return replaceChildren(this.details);
    const mine = this.session.control.mine;
    const features = one.features.map(({ name, on, doc, refusal }) => {
      const off = !mine || (Boolean(refusal) && !on);
      const set = () => this.session.request("feature", { controllet: one.name, name, on: !on });
      const feature = holdButton(this.holding, spaced(name), set, {
        id: `feature-${name}`,
        "aria-pressed": String(on),
        "aria-label": `Switch ${spaced(name)} ${on ? "off" : "on"} while held`,
        disabled: off,
        title: doc,
      });
      return refusal && !on ? div("refused", feature, h("span", { class: "hint" }, refusal)) : feature;
    });
    const parameters = h(
      "fieldset",
      { class: "plain", disabled: !mine },
      h("legend", { class: "visually-hidden" }, `Parameters of ${one.name}`),
      parameterList(one, {
        set: (name, value) => this.session.request("parameter", { controllet: one.name, name, value }),
        holding: this.holding,
        drafts: this.drafts,
      }),
    );
    replaceChildren(
      this.details,
      h("h2", {}, one.name),
      features.length ? h("h3", {}, "Features") : null,
      features.length ? row(...features) : null,
      h("h3", {}, "Parameters"),
      parameters,
    );
  }
}

/** Result and cost of a switch, in one sentence. */
export function switchText(answer: SwitchAnswer): string {
  const times = answer.times_ms;
  const steps = (answer.torque_steps ?? []).map(
    (step) => `${step.arm} ${fixed(step.sent_nm, 2)} N m (computed ${fixed(step.computed_nm, 2)})`,
  );
  return [
    `Started ${listed(answer.started ?? []) || "nothing"}.`,
    answer.stopped?.length ? `Stopped ${listed(answer.stopped)}.` : "",
    times
      ? `Waited ${fixed(times.received_to_taken, 2)} ms for the cycle, first torque ${fixed(times.taken_to_first_torque, 3)} ms later.`
      : "",
    steps.length ? `Largest torque step of a joint: ${steps.join(", ")}.` : "",
  ]
    .filter(Boolean)
    .join(" ");
}

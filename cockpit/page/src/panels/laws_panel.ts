// Control laws: which controllet owns which arm, what else fits, its features and parameters, and what a switch cost.
import type { ControlletInfo, SwitchAnswer } from "../model/description.ts";
import type { Session } from "../model/session.ts";
import { h, replaceChildren } from "../ui/dom.ts";
import { fixed, listed, spaced } from "../ui/words.ts";
import { parameterList } from "./parameter_list.ts";

export class LawsPanel {
  readonly element = h("div", {});
  private readonly groups = h("div", { class: "section" });
  private readonly result = h("p", { class: "hint", role: "status" });
  private readonly details = h("div", { class: "section" });
  private chosen = "";
  private shown = "";

  constructor(private readonly session: Session) {
    this.element.append(this.groups, this.details);
    session.on("list", () => this.update());
    session.on("control", () => this.update());
    session.on("scene", () => {
      this.chosen = this.shown = "";
      this.update();
    });
  }

  /** Called with every state, too: the owner of an arm may change by itself. */
  update(): void {
    const active = this.session.list.map((one) => this.isActive(one));
    const key = JSON.stringify([this.session.list, active, this.session.control.mine, this.chosen]);
    if (key === this.shown) return;
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
    const choose = h(
      "button",
      { type: "button", id: `choose-${one.name}`, class: "quiet fill law-name", "aria-pressed": String(chosen) },
      h("span", { class: "law-title" }, one.name),
      h("span", { class: "law-type" }, spaced(one.type)),
    );
    choose.addEventListener("click", () => {
      this.chosen = one.name;
      this.update();
    });
    const act = h(
      "button",
      {
        type: "button",
        id: `switch-${one.name}`,
        disabled: !this.session.control.mine || active,
        "aria-label": active ? `${one.name} is active` : `Activate ${one.name}`,
        onclick: () => void this.activate(one),
      },
      active ? "Active" : "Activate",
    );
    return h("div", { class: `row law ${active ? "active" : ""}` }, choose, act);
  }

  private async activate(one: ControlletInfo): Promise<void> {
    const answer = (await this.session.request("switch", { activate: [one.name] })) as SwitchAnswer;
    this.result.textContent = answer.ok ? switchText(answer) : `Refused: ${answer.reason ?? answer.verdict}`;
    if (answer.ok) this.chosen = one.name;
    this.update();
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
      const box = h("input", { type: "checkbox", id: `feature-${name}`, checked: on, disabled: off });
      box.addEventListener("change", () => {
        void this.session.request("feature", { controllet: one.name, name, on: box.checked }).then((answer) => {
          if (!answer.ok) box.checked = !box.checked;
        });
      });
      const label = h("label", { class: "check", title: doc }, box, spaced(name));
      return refusal && !on ? h("div", { class: "refused" }, label, h("span", { class: "hint" }, refusal)) : label;
    });
    const parameters = h(
      "fieldset",
      { class: "plain", disabled: !mine },
      h("legend", { class: "visually-hidden" }, `Parameters of ${one.name}`),
      parameterList(one, (controllet, name, value) => this.session.request("parameter", { controllet, name, value })),
    );
    replaceChildren(
      this.details,
      h("h2", {}, one.name),
      features.length ? h("h3", {}, "Features") : null,
      features.length ? h("div", { class: "row" }, ...features) : null,
      h("h3", {}, "Parameters"),
      parameters,
    );
  }
}

/** What a switch started and cost, in a sentence. */
export function switchText(answer: SwitchAnswer): string {
  const times = answer.times_ms;
  const steps = (answer.torque_steps ?? []).map(
    (step) => `${step.arm} ${fixed(step.sent_nm, 2)} N m (computed ${fixed(step.wanted_nm, 2)})`,
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

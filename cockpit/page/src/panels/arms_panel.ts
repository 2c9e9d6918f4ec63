// A card for each arm.
import type { ControlletInfo } from "../model/description.ts";
import type { LiveState, SceneInfo } from "../model/live.ts";
import type { Session } from "../model/session.ts";
import { h, replaceChildren } from "../ui/dom.ts";
import { ArmCard, type ArmFigures } from "./arm_card.ts";

export class ArmsPanel {
  readonly element = h("aside", { class: "arms", "aria-label": "Arms", tabindex: 0 });
  private cards: ArmCard[] = [];

  constructor(private readonly session: Session) {}

  build(scene: SceneInfo): void {
    this.cards = scene.arms.map(
      (arm, k) =>
        new ArmCard(
          arm,
          k,
          () => void this.session.request("recover", { arm: arm.name }),
          () => void this.session.request("reconnect", { arm: arm.name }),
        ),
    );
    replaceChildren(this.element, ...this.cards.map((card) => card.element));
  }

  update(): void {
    const { state } = this.session;
    if (!state) return;
    this.cards.forEach((card, k) => {
      const arm = state.arms[k];
      if (arm) card.update(arm, figuresOf(this.session.controllet(arm.controllet), state));
    });
  }
}

/** What the arm's owner says about itself: features that are on, energies in its tanks. */
export function figuresOf(owner: ControlletInfo | undefined, state: LiveState): ArmFigures {
  return {
    features: owner?.features.filter((one) => one.on).map((one) => one.name) ?? [],
    tanks: state.outputs
      .filter((one) => one.controllet === owner?.name && /tank|energy/.test(one.name))
      .map((one) => ({ name: one.name, value: one.values[0] ?? NaN })),
  };
}

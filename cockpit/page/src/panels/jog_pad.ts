// Twelve buttons that move a hand while they are held: six ways along the axes, six turns about them.
import type { Holding, Motion } from "../safety/holding.ts";
import type { Deflection } from "../teleop/jog.ts";
import { h } from "../ui/dom.ts";

type Six = readonly [number, number, number, number, number, number];

const kButtons: { text: string; label: string; six: Six }[] = [
  { text: "▲ up", label: "Move up", six: [0, 0, 1, 0, 0, 0] },
  { text: "↑ away", label: "Move away", six: [0, 1, 0, 0, 0, 0] },
  { text: "▼ down", label: "Move down", six: [0, 0, -1, 0, 0, 0] },
  { text: "← left", label: "Move left", six: [-1, 0, 0, 0, 0, 0] },
  { text: "↓ back", label: "Move back", six: [0, -1, 0, 0, 0, 0] },
  { text: "right →", label: "Move right", six: [1, 0, 0, 0, 0, 0] },
];

const kTurns: { text: string; label: string; six: Six }[] = [
  { text: "⟲ turn", label: "Turn left", six: [0, 0, 0, 0, 0, 1] },
  { text: "pitch ↑", label: "Pitch up", six: [0, 0, 0, 1, 0, 0] },
  { text: "turn ⟳", label: "Turn right", six: [0, 0, 0, 0, 0, -1] },
  { text: "roll ←", label: "Roll left", six: [0, 0, 0, 0, -1, 0] },
  { text: "pitch ↓", label: "Pitch down", six: [0, 0, 0, -1, 0, 0] },
  { text: "roll →", label: "Roll right", six: [0, 0, 0, 0, 1, 0] },
];

export function jogPad(holding: Holding, motion: (deflection: () => Deflection) => Motion): HTMLElement {
  const button = ({ text, label, six }: (typeof kButtons)[number]) => {
    const element = h("button", { type: "button", class: "hold", "aria-label": `${label} while held` }, text);
    const deflection: Deflection = { linear: [six[0], six[1], six[2]], angular: [six[3], six[4], six[5]] };
    holding.bindButton(
      element,
      label,
      motion(() => deflection),
    );
    return element;
  };
  return h(
    "div",
    { class: "jog" },
    h("div", { class: "jog-grid", role: "group", "aria-label": "Move the hand" }, ...kButtons.map(button)),
    h("div", { class: "jog-grid", role: "group", "aria-label": "Turn the hand" }, ...kTurns.map(button)),
  );
}

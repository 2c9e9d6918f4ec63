// A gamepad of the standard layout as two deflections: the left stick moves in the plane, the triggers lower and raise,
// the right stick turns; the bumpers roll. With two arms, each stick leads a hand of its own.
import { shaped, type Deflection } from "./jog.ts";

/** What is used of the browser's Gamepad, so that tests can hand in plain objects. */
export interface PadLike {
  readonly connected: boolean;
  readonly axes: readonly number[];
  readonly buttons: readonly { readonly pressed: boolean; readonly value: number }[];
}

// Indices of the standard layout.
export const kPad = { south: 0, east: 1, west: 2, north: 3, left: 4, right: 5, down: 6, up: 7, back: 8, start: 9 };

export interface PadReading {
  /** The dead-man button: the right bumper, which the index finger keeps pressed. */
  held: boolean;
  stop: boolean;
  first: Deflection;
  second: Deflection;
}

/** With `hands` 2 the left stick leads the first hand in the plane and the right stick the second. */
export function readPad(pad: PadLike, hands: 1 | 2): PadReading {
  const axis = (k: number) => shaped(pad.axes[k] ?? 0);
  const button = (k: number) => pad.buttons[k]?.value ?? 0;
  const pressed = (k: number) => pad.buttons[k]?.pressed ?? false;
  const vertical = shaped(button(kPad.up)) - shaped(button(kPad.down));
  const held = pad.connected && pressed(kPad.right);
  const stop = pad.connected && pressed(kPad.east);
  const negated = (value: number) => 0 - value; // never minus zero
  if (hands === 2) {
    return {
      held,
      stop,
      first: { linear: [axis(0), negated(axis(1)), vertical], angular: [0, 0, 0] },
      second: { linear: [axis(2), negated(axis(3)), vertical], angular: [0, 0, 0] },
    };
  }
  const roll = (pressed(12) ? 1 : 0) - (pressed(13) ? 1 : 0);
  return {
    held,
    stop,
    first: {
      linear: [axis(0), negated(axis(1)), vertical],
      angular: [negated(axis(3)), roll, negated(axis(2))],
    },
    second: { linear: [0, 0, 0], angular: [0, 0, 0] },
  };
}

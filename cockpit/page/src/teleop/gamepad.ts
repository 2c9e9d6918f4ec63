// A gamepad moves one hand or two while its right bumper is held. Browsers send no events for its buttons, so
// they are read in every frame, and that reading is reported to the run. In the standard layout the left
// stick moves in the plane, the triggers lower and raise, the right stick turns; the bumpers roll. With two
// arms, each stick moves a hand.
import type { Holding, Motion } from "../safety/holding.ts";
import { shaped, type Deflection } from "./jog.ts";

/** The used part of the browser's Gamepad, so that tests can pass plain objects. */
export interface PadLike {
  readonly connected: boolean;
  readonly axes: readonly number[];
  readonly buttons: readonly { readonly pressed: boolean; readonly value: number }[];
}

// Indices of the standard layout.
export const kPad = { south: 0, east: 1, west: 2, north: 3, left: 4, right: 5, down: 6, up: 7, back: 8, start: 9 };

export interface PadReading {
  /** The dead-man button: the right bumper, held by the index finger. */
  held: boolean;
  stop: boolean;
  first: Deflection;
  second: Deflection;
}

/** With `hands` 2 the left stick moves the first hand in the plane and the right stick the second. */
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

export class GamepadJog {
  enabled = false;
  hands: 1 | 2 = 1;
  private wasHeld = false;
  private wasStop = false;
  private reading: PadReading | undefined;

  constructor(
    private readonly holding: Holding,
    private readonly motion: (hand: 0 | 1, deflection: () => Deflection) => Motion,
    private readonly stop: () => void,
  ) {}

  /** The name of the pad in use; undefined without one. */
  name(): string | undefined {
    return this.pad()?.id;
  }

  /** Reads the pad, in the handler of a drawn frame before the gate is read. */
  frame(): void {
    const pad = this.pad();
    this.reading = pad && readPad(pad, this.hands);
    const { held = false, stop = false } = this.reading ?? {};
    if (stop && !this.wasStop) this.stop();
    this.wasStop = stop;
    // Browsers also report pads to unfocused windows, where they serve another program.
    if (this.enabled && held && !this.wasHeld && document.hasFocus()) this.begin();
    this.wasHeld = held;
  }

  private begin(): void {
    const read = () => this.enabled && (this.reading?.held ?? false);
    this.holding.begin(
      "gamepad",
      read,
      this.motion(0, () => this.reading!.first),
    );
    if (this.hands === 2)
      this.holding.begin(
        "gamepad, second hand",
        read,
        this.motion(1, () => this.reading!.second),
      );
  }

  private pad(): Gamepad | undefined {
    return navigator.getGamepads().find((pad): pad is Gamepad => pad !== null && pad.connected) ?? undefined;
  }
}

// A gamepad leads one hand or two while its right bumper is held. Browsers tell nothing about its buttons, so they are
// read in every frame; that reading is what the run hears of.
import type { Holding, Motion } from "../safety/holding.ts";
import { readPad, type PadReading } from "./gamepad_reading.ts";
import type { Deflection } from "./jog.ts";

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

  /** Reads the pad, in the handler of a drawn frame and before the gate is read. */
  frame(): void {
    const pad = this.pad();
    this.reading = pad && readPad(pad, this.hands);
    const { held = false, stop = false } = this.reading ?? {};
    if (stop && !this.wasStop) this.stop();
    this.wasStop = stop;
    // Browsers tell about pads in windows without the focus, too, where they serve another program.
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

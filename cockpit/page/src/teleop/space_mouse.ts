// A SpaceMouse over WebHID. It has no button that one holds while moving, so its left button is the dead-man button, or,
// if the operator chooses so, a deflected cap: a hand that lets go of it lets it spring back.
import type { Holding, Motion } from "../safety/holding.ts";
import { shaped, type Deflection } from "./jog.ts";
import type { Vector3 } from "./vectors.ts";

export const kVendors = [0x256f, 0x046d];
// Input reports of six-axis mice over HID, as the devices send them: report 1 has the translation and, on newer devices,
// the rotation behind it; report 2 the rotation on older ones; report 3 the buttons, a bit each. All axes are signed
// 16-bit little-endian numbers of about 350 at the end.
const kFullScale = 350;

export interface SpaceMouseState {
  deflection: Deflection;
  buttons: number;
}

export const kAtRest: SpaceMouseState = { deflection: { linear: [0, 0, 0], angular: [0, 0, 0] }, buttons: 0 };

/** The state after one report. Reports of an unknown number or a wrong length change nothing. */
export function afterReport(state: SpaceMouseState, id: number, data: DataView): SpaceMouseState {
  if (id === 1 && data.byteLength >= 12) {
    return { ...state, deflection: { linear: axes(data, 0), angular: axes(data, 6) } };
  }
  if (id === 1 && data.byteLength >= 6) {
    return { ...state, deflection: { ...state.deflection, linear: axes(data, 0) } };
  }
  if (id === 2 && data.byteLength >= 6) {
    return { ...state, deflection: { ...state.deflection, angular: axes(data, 0) } };
  }
  if (id === 3 && data.byteLength >= 1) {
    let buttons = 0;
    for (let k = 0; k < Math.min(4, data.byteLength); ++k) buttons |= data.getUint8(k) << (8 * k);
    return { ...state, buttons: buttons >>> 0 };
  }
  return state;
}

// The device's x is right, its y towards the operator and its z down; ours are right, away and up. Both are
// right-handed, so rotations change the same way.
function axes(data: DataView, offset: number): Vector3 {
  const at = (k: number) => {
    const value = data.getInt16(offset + 2 * k, true) / kFullScale;
    return Math.max(-1, Math.min(1, value));
  };
  return [at(0), 0 - at(1), 0 - at(2)];
}

const kSilence = 150; // silence of a deflected cap, which reports continuously, after which the device counts
// as gone [ms]
const kRest = 10_000; // longest silence of a cap at rest, which sends no reports: its button may have been
// released [ms]
const kHeldButton = 1;
const kStopButton = 2;

export class SpaceMouse {
  enabled = false;
  /** A deflected cap is enough. */
  capHolds = false;
  state: SpaceMouseState = kAtRest;
  private device: HIDDevice | undefined;
  private heard = -Infinity;
  private wasStop = false;
  private gripped = false;

  constructor(
    private readonly holding: Holding,
    private readonly motion: (deflection: () => Deflection) => Motion,
    private readonly stop: () => void,
    private readonly changed: () => void,
  ) {
    if (!SpaceMouse.supported) return;
    navigator.hid.addEventListener("disconnect", (event) => {
      if (event.device !== this.device) return;
      this.device = undefined;
      this.state = kAtRest;
      this.holding.letGo("spacemouse", "the SpaceMouse was unplugged");
      this.changed();
    });
  }

  static get supported(): boolean {
    return "hid" in navigator && navigator.hid !== undefined;
  }

  get name(): string | undefined {
    return this.device?.productName;
  }

  /** Lets the operator choose the device, as browsers require; only from a click. */
  async choose(): Promise<void> {
    const devices = await navigator.hid.requestDevice({ filters: kVendors.map((vendorId) => ({ vendorId })) });
    const device = devices[0];
    if (!device) return;
    if (!device.opened) await device.open();
    this.device = device;
    device.addEventListener("inputreport", (event) => this.take(event.reportId, event.data));
    this.changed();
  }

  private take(id: number, data: DataView): void {
    const state = afterReport(this.state, id, data);
    if (state === this.state) return; // another report, such as the battery's, does not concern the cap
    this.state = state;
    this.heard = performance.now();
    const stop = (this.state.buttons & kStopButton) !== 0;
    if (stop && !this.wasStop) this.stop();
    this.wasStop = stop;
    // A new press only: its reports go on when the window loses the focus, and must not renew a hold that this ended.
    const pressed = this.grips() && !this.gripped;
    this.gripped = this.grips();
    if (this.enabled && pressed && document.hasFocus() && !this.holding.holds("spacemouse")) {
      this.holding.begin(
        "spacemouse",
        () => this.read(),
        this.motion(() => this.deflection()),
      );
    }
  }

  // An unreachable device is silent while its receiver is still plugged in: silence counts as release.
  private read(): boolean {
    if (!this.enabled || !this.device?.opened || !this.grips()) return false;
    return performance.now() - this.heard < (this.isDeflected() ? kSilence : kRest);
  }

  private grips(): boolean {
    return (this.state.buttons & kHeldButton) !== 0 || (this.capHolds && this.isDeflected());
  }

  private isDeflected(): boolean {
    const { linear, angular } = this.deflection();
    return [...linear, ...angular].some((value) => value !== 0);
  }

  private deflection(): Deflection {
    const bent = (v: Vector3): Vector3 => [shaped(v[0]), shaped(v[1]), shaped(v[2])];
    return { linear: bent(this.state.deflection.linear), angular: bent(this.state.deflection.angular) };
  }
}

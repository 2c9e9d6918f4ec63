// A SpaceMouse over WebHID. It has no button that one holds while moving, so its left button is the dead-man button, or,
// if the operator chooses so, a deflected cap: a hand that lets go of it lets it spring back.
import type { Holding, Motion } from "../safety/holding.ts";
import { shaped, type Deflection } from "./jog.ts";
import { afterReport, kAtRest, kVendors, type SpaceMouseState } from "./space_mouse_report.ts";
import type { Vector3 } from "./vectors.ts";

const kSilence = 150; // [ms] without a report of a deflected cap, which reports all the time: the device is gone
const kRest = 10_000; // [ms] of a cap at rest, which says nothing: its button may have been let go meanwhile
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

  /** Asks the operator which device, as browsers require; from a click only. */
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
    if (state === this.state) return; // another report, of the battery for example, says nothing about the cap
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

  // A device out of reach says nothing, while its receiver is still plugged in: silence is release.
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

// Devices that move an arm: each is switched on separately, and shows whether it is present and how it
// is held.
import type { GamepadJog } from "../teleop/gamepad.ts";
import { Headset } from "../teleop/headset.ts";
import { kKeyHelp, type KeyboardJog } from "../teleop/keyboard.ts";
import { SpaceMouse } from "../teleop/space_mouse.ts";
import { button, check, div, fold, h, row, section, setText, icon, type IconName } from "../ui/dom.ts";
import { Slider } from "./controls.ts";

export interface Devices {
  keyboard: KeyboardJog;
  gamepad: GamepadJog;
  mouse: SpaceMouse;
  headset: Headset;
}

export class DevicePanel {
  readonly element = section("Devices");
  private readonly padStatus = h("p", { class: "hint" });
  private readonly mouseStatus = h("p", { class: "hint" });
  private readonly headsetButton = button("Enter", () => this.enter(), {
    disabled: true,
    "aria-label": "Enter or leave the headset",
  });
  private readonly headsetStatus = h("p", { class: "hint" }, "No headset found.");

  constructor(
    private readonly devices: Devices,
    private readonly show: (why: string) => void,
  ) {
    const { keyboard, gamepad, mouse } = devices;
    this.element.append(
      this.device("keyboard", "Keyboard", (on) => (keyboard.enabled = on), h("p", { class: "hint" }, `${kKeyHelp}.`)),
      this.device(
        "gamepad",
        "Gamepad",
        (on) => (gamepad.enabled = on),
        this.padStatus,
        check("Gamepad: each stick moves a hand", (on) => (gamepad.hands = on ? 2 : 1)),
      ),
      this.device("mouse", "SpaceMouse", (on) => (mouse.enabled = on), this.mouseStatus, this.mouseOptions()),
      this.headset(),
    );
    this.update();
  }

  update(): void {
    const { gamepad, mouse, headset } = this.devices;
    const pad = gamepad.name();
    setText(
      this.padStatus,
      pad ? `${pad}. Hold the right bumper; B stops.` : "Press a button of the gamepad, so that the browser shows it.",
    );
    setText(
      this.mouseStatus,
      !SpaceMouse.supported
        ? "This browser has no WebHID."
        : mouse.name
          ? `${mouse.name}. Hold the left button; the right one stops.`
          : "Choose the device first.",
    );
    setText(this.headsetButton, headset.session ? "Leave" : "Enter");
  }

  /** The presence of a headset is known only after a query. */
  async look(): Promise<void> {
    const found = await Headset.supported();
    this.headsetButton.disabled = !found;
    setText(this.headsetStatus, found ? "Squeeze to move the hand; B or Y stops." : "No headset found.");
  }

  private device(name: IconName, title: string, set: (on: boolean) => void, ...more: HTMLElement[]): HTMLElement {
    const details = h("div", { class: "device-details", hidden: true }, ...more);
    const switched = (on: boolean) => {
      set(on);
      details.hidden = !on;
    };
    return div("device", check([icon(name), title], switched), details);
  }

  private mouseOptions(): HTMLElement {
    const { mouse } = this.devices;
    const choose = () =>
      mouse.choose().catch((error: Error) => this.show(`The SpaceMouse cannot be opened: ${error.message}`));
    return row(
      button("Choose device", () => void choose(), { disabled: !SpaceMouse.supported }),
      check("Moving the cap is enough", (on) => (mouse.capHolds = on)),
    );
  }

  private enter(): void {
    const { headset } = this.devices;
    const done = headset.session ? headset.stop() : headset.start();
    done.then(() => this.update()).catch((error: Error) => this.show(`The headset did not start: ${error.message}`));
  }

  private headset(): HTMLElement {
    const { headset } = this.devices;
    const scale = (value: number) => (headset.mapping.scale = value);
    const turn = (value: number) => (headset.mapping.heading_rad = (value * Math.PI) / 180);
    return div(
      "device",
      row(icon("headset"), h("span", { class: "fill" }, "Headset"), this.headsetButton),
      this.headsetStatus,
      fold(
        "Workspace",
        new Slider({ label: "Scale of the motion", min: 0.1, max: 3, step: 0.1, value: 1, input: scale }).element,
        new Slider({ label: "You look along", unit: "°", min: -180, max: 180, step: 5, value: 0, input: turn }).element,
        check("Headset: a hand for each arm", (on) => (headset.hands = on ? 2 : 1)),
      ),
    );
  }
}

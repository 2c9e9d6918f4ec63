// Devices that lead an arm: each is switched on by itself, and says whether it is there and how it is held.
import type { GamepadJog } from "../teleop/gamepad.ts";
import { Headset } from "../teleop/headset.ts";
import { kKeyHelp, type KeyboardJog } from "../teleop/keyboard.ts";
import { SpaceMouse } from "../teleop/space_mouse.ts";
import { h, setText } from "../ui/dom.ts";
import { icon, type IconName } from "../ui/icons.ts";
import { Slider } from "./slider.ts";

export interface Devices {
  keyboard: KeyboardJog;
  gamepad: GamepadJog;
  mouse: SpaceMouse;
  headset: Headset;
}

export class DevicePanel {
  readonly element = h("div", { class: "section" }, h("h2", {}, "Devices"));
  private readonly padStatus = h("p", { class: "hint" });
  private readonly mouseStatus = h("p", { class: "hint" });
  private readonly headsetButton = h("button", { type: "button", disabled: true }, "Enter");
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
        this.twoHands("Gamepad: both sticks lead a hand", (on) => (gamepad.hands = on ? 2 : 1)),
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

  /** Whether a headset is there is known only after asking. */
  async look(): Promise<void> {
    const found = await Headset.supported();
    this.headsetButton.disabled = !found;
    setText(this.headsetStatus, found ? "Squeeze to lead the hand; B or Y stops." : "No headset found.");
  }

  private device(name: IconName, title: string, set: (on: boolean) => void, ...more: HTMLElement[]): HTMLElement {
    const box = h("input", { type: "checkbox" });
    const details = h("div", { class: "device-details", hidden: true }, ...more);
    box.addEventListener("change", () => {
      set(box.checked);
      details.hidden = !box.checked;
    });
    return h("div", { class: "device" }, h("label", { class: "check" }, box, icon(name), title), details);
  }

  private twoHands(text: string, set: (on: boolean) => void): HTMLElement {
    const box = h("input", { type: "checkbox" });
    box.addEventListener("change", () => set(box.checked));
    return h("label", { class: "check" }, box, text);
  }

  private mouseOptions(): HTMLElement {
    const choose = h("button", { type: "button", disabled: !SpaceMouse.supported }, "Choose device");
    choose.addEventListener("click", () => {
      this.devices.mouse
        .choose()
        .catch((error: Error) => this.show(`The SpaceMouse cannot be opened: ${error.message}`));
    });
    const cap = this.twoHands("Moving the cap is enough", (on) => (this.devices.mouse.capHolds = on));
    return h("div", { class: "row" }, choose, cap);
  }

  private headset(): HTMLElement {
    const { headset } = this.devices;
    this.headsetButton.addEventListener("click", () => {
      const done = headset.session ? headset.stop() : headset.start();
      done.then(() => this.update()).catch((error: Error) => this.show(`The headset did not start: ${error.message}`));
    });
    const scale = new Slider({
      label: "Scale of the motion",
      min: 0.1,
      max: 3,
      step: 0.1,
      value: 1,
      input: (value) => (headset.mapping.scale = value),
    });
    const heading = new Slider({
      label: "You look along",
      unit: "°",
      min: -180,
      max: 180,
      step: 5,
      value: 0,
      input: (value) => (headset.mapping.heading_rad = (value * Math.PI) / 180),
    });
    this.headsetButton.setAttribute("aria-label", "Enter or leave the headset");
    return h(
      "div",
      { class: "device" },
      h("div", { class: "row" }, icon("headset"), h("span", { class: "fill" }, "Headset"), this.headsetButton),
      this.headsetStatus,
      h(
        "details",
        {},
        h("summary", {}, "Workspace"),
        scale.element,
        heading.element,
        this.twoHands("Headset: a hand for each arm", (on) => (headset.hands = on ? 2 : 1)),
      ),
    );
  }
}

// Assembles the page: one session, the regions that show it, and the loop that reads the buttons.
import { type LiveState, type SceneInfo, poseAt } from "./model/live.ts";
import { History } from "./model/history.ts";
import type { Session } from "./model/session.ts";
import { ArmToolsPanel } from "./panels/arm_tools_panel.ts";
import { ArmsPanel } from "./panels/arm_card.ts";
import { Bar } from "./panels/bar.ts";
import { DevicePanel } from "./panels/device_panel.ts";
import { LawsPanel } from "./panels/laws_panel.ts";
import { LoopPanel } from "./panels/loop_panel.ts";
import { MovePanel } from "./panels/move_panel.ts";
import { PlotsPanel, type Quantity } from "./panels/plots_panel.ts";
import { TimelinePanel } from "./panels/timeline_panel.ts";
import { ViewPanel } from "./panels/view_panel.ts";
import { WorldPanel } from "./panels/world_panel.ts";
import { Holding, type Motion } from "./safety/holding.ts";
import { TargetGizmo } from "./scene3d/gizmo.ts";
import { World } from "./scene3d/world.ts";
import { GamepadJog } from "./teleop/gamepad.ts";
import { Headset } from "./teleop/headset.ts";
import type { Deflection } from "./teleop/jog.ts";
import { KeyboardJog } from "./teleop/keyboard.ts";
import { address, PoseMotion, type PoseSource } from "./teleop/motions.ts";
import { SpaceMouse } from "./teleop/space_mouse.ts";
import type { Pose } from "./teleop/vectors.ts";
import { button, h } from "./ui/dom.ts";
import { Tabs } from "./ui/tabs.ts";
import { ThemeSwitch } from "./ui/theme.ts";
import { Toasts } from "./ui/toasts.ts";

/** What the page needs of its connection besides requests. */
export interface PageLine {
  beat(): void;
  release(cause: string): void;
  stop(): void;
}

const kLiveSeconds = 10; // that live plots show
const kPanelPeriod = 100; // [ms] between two updates of texts

export class App {
  readonly theme = new ThemeSwitch();
  readonly toasts = new Toasts();
  readonly history = new History();
  readonly holding: Holding;
  readonly view: ViewPanel;
  readonly plots: PlotsPanel;
  readonly loop: LoopPanel;
  readonly timeline: TimelinePanel;
  private readonly bar: Bar;
  private readonly arms: ArmsPanel;
  private readonly move: MovePanel;
  private readonly laws: LawsPanel;
  private readonly devices: { keyboard: KeyboardJog; gamepad: GamepadJog; mouse: SpaceMouse; headset: Headset };
  private readonly devicePanel: DevicePanel;
  /** Called in every drawn frame with the time since the last one [s]. */
  readonly frames: ((seconds: number) => void)[] = [];
  private readonly dock: Tabs;
  private lastPanels = 0;
  private lastFrame = 0;
  private fresh: LiveState | undefined;

  constructor(
    readonly session: Session,
    private readonly line: PageLine,
    log: { title: string; panel: HTMLElement },
    watch: (names: string[]) => void,
  ) {
    const refuse = (why: string) => this.toasts.show(why);
    this.holding = new Holding(line, refuse);
    this.bar = new Bar(session, this.theme, () => this.stop());
    this.arms = new ArmsPanel(session);
    this.view = new ViewPanel(session);
    this.devices = this.makeDevices();
    this.devicePanel = new DevicePanel(this.devices, refuse);
    this.move = new MovePanel(
      session,
      this.holding,
      (deflection) => this.motion(0, { deflection }),
      this.devicePanel.element,
      (on) => (this.view.dragging = on),
    );
    this.laws = new LawsPanel(session, this.holding);
    this.timeline = new TimelinePanel(session, this.theme);
    this.plots = new PlotsPanel(this.history, this.theme, watch, refuse);
    this.loop = new LoopPanel(this.theme);
    this.view.gizmo = new TargetGizmo(this.view.stage, this.holding, (goal) => this.motion(0, { goal }));
    this.dock = this.lay(log);
    session.on("refused", ({ request, reason }) => this.toasts.show(`${request}: ${reason}`));
    session.on("released", (cause) => {
      this.holding.letGoAll("the run ended the hold");
      this.toasts.show(`The run ended the hold: ${cause}`);
    });
    session.on("scene", (scene) => this.build(scene));
    session.on("state", (state) => (this.fresh = state));
    session.on("status", (status) => status !== "connected" && this.holding.letGoAll("the connection was lost"));
    session.on("control", (control) => !control.mine && this.holding.letGoAll("another page has control"));
    this.theme.addEventListener("change", () => this.paint());
    this.view.stage.beforeFrame.push((now) => this.frame(now));
    void this.devicePanel.look();
  }

  private stop(): void {
    this.holding.letGoAll("stopped");
    this.line.stop();
  }

  private motion(hand: 0 | 1, source: PoseSource, begun?: (target: Pose) => void): Motion {
    const arm = () => (hand === 0 ? this.move.arm : this.move.secondArm);
    const heading = () => this.view.stage.heading();
    return new PoseMotion(this.session, arm, () => this.move.settings, heading, source, begun);
  }

  private makeDevices(): { keyboard: KeyboardJog; gamepad: GamepadJog; mouse: SpaceMouse; headset: Headset } {
    const stop = () => this.stop();
    const one = (deflection: () => Deflection) => this.motion(0, { deflection });
    return {
      keyboard: new KeyboardJog(this.holding, one),
      gamepad: new GamepadJog(this.holding, (hand, deflection) => this.motion(hand, { deflection }), stop),
      mouse: new SpaceMouse(this.holding, one, stop, () => this.devicePanel.update()),
      headset: new Headset(this.view.stage.renderer, this.holding, {
        motion: (hand, goal, begun) => this.motion(hand, { goal }, begun),
        stop,
        ended: () => this.devicePanel.update(),
      }),
    };
  }

  private lay(log: { title: string; panel: HTMLElement }): Tabs {
    const tools = new Tabs("Tools", [
      { title: "Move", panel: this.move.element },
      { title: "Laws", panel: this.laws.element },
      { title: "Arms", panel: new ArmToolsPanel(this.session, this.holding).element },
      { title: "World", panel: new WorldPanel(this.session, this.holding).element },
    ]);
    const dock = new Tabs("Records", [
      { title: "Timeline", panel: this.timeline.element },
      { title: "Plots", panel: this.plots.element },
      { title: "Loop", panel: this.loop.element },
      log,
    ]);
    const region = (tabs: Tabs, name: string, label: string, panels: HTMLElement[]) =>
      h("section", { class: name, "aria-label": label }, tabs.list, ...panels);
    document.body.append(
      this.bar.element,
      this.arms.element,
      this.view.element,
      region(tools, "tools", "Tools", tools.panels),
      region(dock, "dock", "Records", dock.panels),
      this.regions(),
      this.toasts.element,
    );
    document.body.dataset["region"] = "tools";
    return dock;
  }

  // On narrow screens one region is shown below the picture.
  private regions(): HTMLElement {
    const bar = h("nav", { class: "regions", "aria-label": "Regions" });
    for (const [region, text] of [
      ["arms", "Arms"],
      ["tools", "Tools"],
      ["dock", "Records"],
    ] as const) {
      const show = () => {
        document.body.dataset["region"] = region;
        for (const one of bar.children) one.setAttribute("aria-pressed", String(one === chosen));
      };
      const chosen = button(text, show, { "aria-pressed": String(region === "tools") });
      bar.append(chosen);
    }
    return bar;
  }

  private build(scene: SceneInfo): void {
    this.view.world?.dispose();
    this.view.world = new World(this.view.stage, scene);
    this.view.world.frame();
    this.arms.build(scene);
    this.paint();
  }

  /** A log has no controls, and a run no player. */
  setMode(kind: Session["kind"]): void {
    document.body.dataset["kind"] = kind;
    this.dock.setHidden("Log", kind !== "log");
    this.dock.show(kind === "log" ? "Log" : "Timeline");
    this.plots.seconds = kind === "log" ? Infinity : kLiveSeconds;
  }

  isLoopShown(): boolean {
    return this.dock.isShown("Loop");
  }

  paintAlso(world: World): void {
    const { theme } = this;
    world.paint(
      [1, 2, 3, 4].map((k) => theme.color(`arm-${k}`)),
      theme.color("warning"),
      theme.color("bad"),
    );
  }

  offer(quantities: readonly Quantity[]): void {
    this.plots.offer(quantities);
  }

  private paint(): void {
    const { theme } = this;
    this.view.stage.paint(theme.color("grid"));
    if (this.view.world) this.paintAlso(this.view.world);
  }

  // The handler of a drawn frame: reads the devices, then the gate, which sends beats, then sends
  // the motions.
  private frame(now: number): void {
    const { xr } = this.view.stage.renderer;
    this.devices.gamepad.frame();
    this.devices.headset.frame(xr.isPresenting ? (xr.getFrame() ?? undefined) : undefined, xr.getReferenceSpace());
    this.holding.frame(now);
    const seconds = Math.min(0.25, (now - this.lastFrame) / 1000);
    this.lastFrame = now;
    for (const call of this.frames) call(seconds);
    const state = this.fresh;
    this.fresh = undefined;
    if (state) {
      this.view.world?.show(state);
      this.followTarget();
    }
    this.plots.update();
    this.timeline.update();
    if (now - this.lastPanels >= kPanelPeriod) {
      this.lastPanels = now;
      this.updatePanels();
    }
  }

  private followTarget(): void {
    const found = address(this.session, this.move.arm, "pose");
    if (typeof found === "string") return;
    const set = this.session.reference(found.controllet, found.input);
    this.view.gizmo?.follow(set && Number.isFinite(set[0]!) ? poseAt(set) : found.state.hand);
  }

  private updatePanels(): void {
    this.bar.update();
    this.arms.update();
    this.move.update();
    this.laws.update();
    this.view.update();
    this.devicePanel.update();
    this.loop.update();
  }
}

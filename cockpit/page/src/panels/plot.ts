// One live plot: the components of one quantity over the last seconds, with freeze, cursor, CSV and PNG.
import uPlot from "uplot";
import { csv, type Columns } from "../model/history.ts";
import { button, div, download, h, textFile, icon } from "../ui/dom.ts";
import type { ThemeSwitch } from "../ui/theme.ts";

export interface PlotSource {
  readonly name: string;
  /** Names of the components: `1` to `7`, or `x`, `y`, `z`. */
  readonly components: readonly string[];
  columns(): Columns;
  dispose(): void;
}

export class Plot {
  readonly element: HTMLElement;
  private readonly body = div("plot-body");
  private readonly freezeButton: HTMLButtonElement;
  private chart: uPlot | undefined;
  private frozen = false;
  private shown: Columns = { t: [], values: [] };
  private readonly resize = new ResizeObserver(() => this.fit());
  private readonly repaint = () => this.build();

  constructor(
    private readonly source: PlotSource,
    private readonly theme: ThemeSwitch,
    private readonly remove: (plot: Plot) => void,
  ) {
    const title = source.name;
    this.freezeButton = this.button("Freeze", `Freeze the plot of ${title}`, () => this.freeze(!this.frozen));
    this.freezeButton.setAttribute("aria-pressed", "false");
    const close = { class: "quiet icon-only", "aria-label": `Remove the plot of ${title}` };
    this.element = h(
      "figure",
      { class: "plot", "aria-label": `Plot of ${title}` },
      h(
        "figcaption",
        { class: "row" },
        h("h3", { class: "fill" }, title),
        this.freezeButton,
        this.button("CSV", `Save the plot of ${title} as CSV`, () => this.saveCsv()),
        this.button("PNG", `Save the plot of ${title} as PNG`, () => this.savePng()),
        button(icon("close", 12), () => this.remove(this), close),
      ),
      this.body,
    );
    theme.addEventListener("change", this.repaint);
    this.resize.observe(this.body);
    this.build();
  }

  update(): void {
    if (this.frozen || !this.chart) return;
    this.shown = this.source.columns();
    this.chart.setData([this.shown.t, ...this.padded()], true);
  }

  dispose(): void {
    this.resize.disconnect();
    this.theme.removeEventListener("change", this.repaint);
    this.chart?.destroy();
    this.source.dispose();
  }

  private padded(): number[][] {
    return this.source.components.map((_, k) => this.shown.values[k] ?? this.shown.t.map(() => NaN));
  }

  private button(text: string, label: string, act: () => void): HTMLButtonElement {
    return button(text, act, { class: "quiet", "aria-label": label });
  }

  private freeze(on: boolean): void {
    this.frozen = on;
    this.freezeButton.setAttribute("aria-pressed", String(on));
  }

  private saveCsv(): void {
    const header = ["t_s", ...this.source.components.map((name) => `${this.source.name}[${name}]`)];
    download(`${fileName(this.source.name)}.csv`, textFile(csv(header, [this.shown.t, ...this.padded()]), "text/csv"));
  }

  private savePng(): void {
    if (!this.chart) return;
    const drawn = this.chart.ctx.canvas;
    const [scale, top] = [devicePixelRatio, 28 * devicePixelRatio];
    const canvas = h("canvas", { width: drawn.width, height: drawn.height + top });
    const pen = canvas.getContext("2d")!;
    pen.fillStyle = this.theme.color("surface");
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.font = `${13 * scale}px sans-serif`;
    pen.fillStyle = this.theme.color("text");
    pen.fillText(this.source.name, 8 * scale, 18 * scale);
    let x = 16 * scale + pen.measureText(this.source.name).width;
    this.source.components.forEach((name, k) => {
      pen.fillStyle = seriesColor(k);
      pen.fillText(name, x, 18 * scale);
      x += pen.measureText(name).width + 10 * scale;
    });
    pen.drawImage(drawn, 0, top);
    canvas.toBlob((blob) => blob && download(`${fileName(this.source.name)}.png`, blob));
  }

  private fit(): void {
    const { clientWidth: width, clientHeight: height } = this.body;
    if (width > 0 && height > 60) this.chart?.setSize({ width, height: height - 24 });
  }

  private build(): void {
    this.chart?.destroy();
    const [ink, grid] = [this.theme.color("muted"), this.theme.color("border")];
    const lines = { stroke: grid, width: 1 };
    const axis = { stroke: ink, grid: lines, ticks: lines, font: "11px sans-serif" };
    const number = (_: uPlot, value: number | null) =>
      value === null || Number.isNaN(value) ? "–" : shortNumber(value);
    this.chart = new uPlot(
      {
        width: Math.max(160, this.body.clientWidth),
        height: Math.max(60, this.body.clientHeight - 24),
        scales: { x: { time: false } },
        axes: [
          { ...axis, size: 26 },
          { ...axis, size: 52 },
        ],
        series: [
          { label: "t [s]", value: number },
          ...this.source.components.map((label, k) => ({ label, stroke: seriesColor(k), width: 1.5, value: number })),
        ],
        cursor: { drag: { x: true, y: false } },
        legend: { live: true },
      },
      [this.shown.t, ...this.padded()],
      this.body,
    );
  }
}

// Distinguishable in both themes and for color-blind readers.
const kSeries = ["#2f86e0", "#e07b1a", "#1f9e77", "#b253d6", "#c2453d", "#8a8f00", "#5b6bd6", "#d0558f"];
export const seriesColor = (k: number): string => kSeries[k % kSeries.length]!;

export function shortNumber(value: number): string {
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) return value.toExponential(2);
  return value.toFixed(size < 1 ? 4 : size < 100 ? 3 : 1);
}

const fileName = (name: string): string => name.replace(/[^\w.-]+/g, "_");

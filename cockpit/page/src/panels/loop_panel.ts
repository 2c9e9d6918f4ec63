// The loop's cycle times as a histogram.
import { Histogram } from "../model/histogram.ts";
import { div, h, row, setText } from "../ui/dom.ts";
import type { ThemeSwitch } from "../ui/theme.ts";
import { fixed } from "../ui/words.ts";

export class LoopPanel {
  readonly element: HTMLElement;
  private histogram = new Histogram();
  private readonly canvas = h("canvas", { class: "histogram", role: "img", "aria-label": "Histogram of cycle times" });
  private readonly text = h("p", { class: "number", role: "status" });

  constructor(private readonly theme: ThemeSwitch) {
    this.element = div("loop", row(h("h3", {}, "Computing time of a cycle [µs]"), this.text), this.canvas);
  }

  take(histogram: Histogram): void {
    this.histogram = histogram;
  }

  update(): void {
    const { histogram, canvas } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (width === 0) return;
    setText(
      this.text,
      histogram.total === 0
        ? "no cycles yet"
        : `median ${fixed(histogram.quantile(0.5), 0)}   99 % ${fixed(histogram.quantile(0.99), 0)}   worst ${fixed(histogram.worst, 0)}   of ${histogram.total} cycles`,
    );
    canvas.width = width * devicePixelRatio;
    canvas.height = height * devicePixelRatio;
    const pen = canvas.getContext("2d")!;
    pen.scale(devicePixelRatio, devicePixelRatio);
    const bins = histogram.counts.length;
    const [left, bottom] = [36, 18];
    const x = (bin: number) => left + (bin / bins) * (width - left - 4);
    // Counts on a logarithmic scale: the rare slow cycle matters more than the exact height of the middle.
    const most = Math.log10(1 + Math.max(1, ...histogram.counts));
    const y = (count: number) => (height - bottom) * (1 - Math.log10(1 + count) / most);
    pen.font = "11px sans-serif";
    pen.fillStyle = this.theme.color("muted");
    for (let decade = 0; decade < Histogram.decades; ++decade) {
      const at = x(1 + decade * Histogram.perDecade);
      pen.fillRect(at, height - bottom, 1, 4);
      pen.fillText(String(10 ** decade), at + 3, height - 5);
    }
    for (let count = 1; Math.log10(1 + count) <= most; count *= 100)
      pen.fillText(count.toLocaleString("en", { notation: "compact" }), 2, y(count) + 4);
    pen.fillStyle = this.theme.color("accent-fill");
    histogram.counts.forEach((count, bin) => {
      if (count > 0) pen.fillRect(x(bin), y(count), (width - left - 4) / bins - 1, height - bottom - y(count));
    });
    // The period of 1 ms: cycles right of it were late.
    pen.fillStyle = this.theme.color("bad");
    pen.fillRect(x(Histogram.bin(1000)), 0, 1, height - bottom);
  }
}

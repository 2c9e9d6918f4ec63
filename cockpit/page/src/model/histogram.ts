// Cycle times in bins of equal ratio, from 1 µs to 10 ms, with exact quantile bounds.

export class Histogram {
  static readonly perDecade = 12;
  static readonly decades = 4;
  readonly counts = new Float64Array(Histogram.perDecade * Histogram.decades + 2);
  total = 0;
  worst = 0;

  add(us: number): void {
    if (!Number.isFinite(us)) return;
    this.counts[Histogram.bin(us)]! += 1;
    this.total += 1;
    this.worst = Math.max(this.worst, us);
  }

  /** Counts made elsewhere, in the same bins. The worst one is known to the precision of its bin. */
  set(counts: readonly number[]): void {
    this.clear();
    counts.forEach((count, bin) => {
      if (bin >= this.counts.length || !(count > 0)) return;
      this.counts[bin] = count;
      this.total += count;
      this.worst = Histogram.edge(bin + 1);
    });
  }

  /** Bin 0 is below 1 µs, the last one from 10 ms on. */
  static bin(us: number): number {
    if (us < 1) return 0;
    const k = Math.floor(Math.log10(us) * Histogram.perDecade + 1e-9);
    return Math.min(Histogram.perDecade * Histogram.decades, k) + 1;
  }

  /** Lower edge of a bin [µs]. */
  static edge(bin: number): number {
    return bin <= 0 ? 0 : 10 ** ((bin - 1) / Histogram.perDecade);
  }

  /** The upper edge of the quantile's bin [µs]; in the last bin the worst value. */
  quantile(share: number): number {
    let left = share * this.total;
    for (let bin = 0; bin < this.counts.length; ++bin) {
      left -= this.counts[bin]!;
      if (left <= 1e-9) return Math.min(this.worst, Histogram.edge(bin + 1));
    }
    return this.worst;
  }

  clear(): void {
    this.counts.fill(0);
    this.total = this.worst = 0;
  }
}

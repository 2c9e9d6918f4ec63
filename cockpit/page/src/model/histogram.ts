// Cycle times in bins of equal ratio, from 1 µs to 10 ms, with exact quantile bounds.

export class Histogram {
  static readonly perDecade = 12;
  static readonly decades = 4;
  readonly total: number;
  /** The upper edge of the last bin with a cycle [µs]. */
  readonly worst: number;

  /** Counts of the bins: the first is below 1 µs, the last one from 10 ms on. */
  constructor(
    readonly counts: readonly number[] = new Array<number>(Histogram.perDecade * Histogram.decades + 2).fill(0),
  ) {
    this.total = counts.reduce((sum, count) => sum + count, 0);
    this.worst = Histogram.edge(counts.findLastIndex((count) => count > 0) + 1);
  }

  static bin(us: number): number {
    if (us < 1) return 0;
    const k = Math.floor(Math.log10(us) * Histogram.perDecade + 1e-9);
    return Math.min(Histogram.perDecade * Histogram.decades, k) + 1;
  }

  /** Lower edge of a bin [µs]. */
  static edge(bin: number): number {
    return bin <= 0 ? 0 : 10 ** ((bin - 1) / Histogram.perDecade);
  }

  /** The upper edge of the quantile's bin [µs]. */
  quantile(share: number): number {
    let left = share * this.total;
    const found = this.counts.findIndex((count) => (left -= count) <= 1e-9);
    return found < 0 ? this.worst : Histogram.edge(found + 1);
  }
}

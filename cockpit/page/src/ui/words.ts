// Names and numbers for display.

// Unit suffixes of parameters and quantities, as in CONVENTIONS.md.
const kUnit = /_(n_nm|nm?|m?m|m?rad|kg|hz|us|ms|[jws])(_per_(m|rad|s2?))*$/;

/** `stiffness_n_per_m` is `stiffness`: its unit is shown beside it. */
export const withoutUnit = (name: string): string => spaced(name.replace(kUnit, ""));

export const spaced = (name: string): string => name.replaceAll("_", " ");

/** With a sign only if negative, and a constant width. */
export function fixed(value: number | undefined, digits: number): string {
  if (value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
}

/** `2:03.4` for 123.4 s. */
export function clock(seconds: number): string {
  if (!Number.isFinite(seconds)) return "–";
  const tenths = Math.max(0, Math.floor(seconds * 10 + 1e-6));
  const minutes = Math.floor(tenths / 600);
  const rest = (tenths - minutes * 600) / 10;
  return `${minutes}:${rest.toFixed(1).padStart(4, "0")}`;
}

export function listed(names: readonly string[]): string {
  if (names.length < 2) return names[0] ?? "";
  return `${names.slice(0, -1).join(", ")} and ${names[names.length - 1]}`;
}

// Light or dark: the system's setting until the operator chooses. The choice is stored in this browser.

export type Theme = "light" | "dark";
const kKey = "multipanda.theme";

export class ThemeSwitch extends EventTarget {
  private readonly system = matchMedia("(prefers-color-scheme: dark)");
  private chosen: Theme | undefined;

  constructor() {
    super();
    const saved = read();
    if (saved === "light" || saved === "dark") this.chosen = saved;
    this.system.addEventListener("change", () => this.apply());
    this.apply();
  }

  get theme(): Theme {
    return this.chosen ?? (this.system.matches ? "dark" : "light");
  }

  switchOver(): void {
    this.chosen = this.theme === "dark" ? "light" : "dark";
    try {
      localStorage.setItem(kKey, this.chosen);
    } catch {
      // Private windows may refuse to store; the choice then lasts until the page is closed.
    }
    this.apply();
  }

  /** The value of a color of the style sheet, for drawings that are not styled by it. */
  color(name: string): string {
    return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  }

  private apply(): void {
    document.documentElement.dataset["theme"] = this.theme;
    this.dispatchEvent(new Event("change"));
  }
}

function read(): string | null {
  try {
    return localStorage.getItem(kKey);
  } catch {
    return null;
  }
}

import { h } from "./dom.ts";

/** Hands a file to the browser's downloads. */
export function download(name: string, content: Blob | string): void {
  const url = typeof content === "string" ? content : URL.createObjectURL(content);
  const link = h("a", { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  if (typeof content !== "string") setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

export const textFile = (text: string, type: string): Blob => new Blob([text], { type });

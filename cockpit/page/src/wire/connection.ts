// The WebSocket: the token first, requests and their answers by number, and reconnection.
import type { Answer } from "../model/description.ts";

export interface ConnectionHooks {
  /** Messages without a request: events of the run. */
  text(message: Record<string, unknown>): void;
  binary(data: ArrayBuffer): void;
  opened(answer: Answer): void;
  /** `again`: it will be retried. */
  closed(why: string, again: boolean): void;
  /** The other end sends unsolicited messages, so silence means that it has gone. */
  isTalking(): boolean;
}

const kLostAnswer: Answer = {
  ok: false,
  verdict: "connection_lost",
  reason: "The connection broke before the answer.",
};
const kSoonest = 300; // delay until the next attempt [ms]
const kLatest = 5000;
const kSilence = 8000; // [ms] without any message, after which the other end counts as gone

/** Explanations of the server's close codes. */
export function closeText(code: number, reason: string): { why: string; again: boolean } {
  if (code === 4401)
    return { why: "The token in the address is wrong. Open the address that the program printed.", again: false };
  if (code === 1001) return { why: reason || "The run has ended.", again: false };
  if (code === 1008)
    return { why: reason || "The run closed the connection: too many messages were sent or left unread.", again: true };
  return { why: "The connection to the run is lost.", again: true };
}

export class Connection {
  private socket: WebSocket | undefined;
  private nextId = 1;
  private readonly waiting = new Map<number, (answer: Answer) => void>();
  private wait = kSoonest;
  private next: ReturnType<typeof setTimeout> | undefined;
  private heard = 0;

  constructor(
    private readonly url: string,
    private readonly token: string,
    private readonly hooks: ConnectionHooks,
  ) {}

  open(): void {
    this.next = undefined;
    const { hooks } = this;
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heard = performance.now();
    socket.addEventListener("open", () => {
      this.heard = performance.now();
      void this.request("hello", { token: this.token }).then((answer) => {
        if (!answer.ok) return;
        this.wait = kSoonest;
        this.hooks.opened(answer);
      });
    });
    socket.addEventListener("message", (event: MessageEvent<string | ArrayBuffer>) => {
      if (this.socket !== socket) return; // given up
      this.heard = performance.now();
      if (typeof event.data === "string") this.take(event.data);
      else this.hooks.binary(event.data);
    });
    socket.addEventListener("close", (event) => this.socket === socket && this.closed(event.code, event.reason));
    const watch = setInterval(() => {
      if (this.socket !== socket || socket.readyState === WebSocket.CLOSED) clearInterval(watch);
      else if (
        performance.now() - this.heard > kSilence &&
        (socket.readyState !== WebSocket.OPEN || hooks.isTalking())
      ) {
        // The closing is not answered either, and the browser would wait long for it.
        clearInterval(watch);
        socket.close();
        this.closed(1006, "");
      }
    }, 1000);
  }

  /** Retries at once if the connection is broken: for urgent messages. */
  hurry(): void {
    if (this.next === undefined) return;
    clearTimeout(this.next);
    this.wait = kSoonest;
    this.open();
  }

  get isOpen(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  request(word: string, fields: Record<string, unknown>): Promise<Answer> {
    if (!this.isOpen) return Promise.resolve(kLostAnswer);
    const id = this.nextId++;
    return new Promise((resolve) => {
      this.waiting.set(id, resolve);
      this.socket!.send(JSON.stringify({ id, do: word, ...fields }));
    });
  }

  /** Without an answer. Dropped if it cannot be sent at once. */
  send(message: Record<string, unknown>): void {
    if (this.isOpen) this.socket!.send(JSON.stringify(message));
  }

  private take(text: string): void {
    let message: Record<string, unknown>;
    try {
      message = JSON.parse(text) as Record<string, unknown>;
    } catch {
      return; // not ours: nothing can be done with it
    }
    const id = message["id"];
    const known = typeof id === "number" ? this.waiting.get(id) : undefined;
    if (!known) return this.hooks.text(message);
    this.waiting.delete(id as number);
    known(message as Answer);
  }

  private closed(code: number, reason: string): void {
    this.socket = undefined;
    for (const resolve of this.waiting.values()) resolve(kLostAnswer);
    this.waiting.clear();
    const { why, again } = closeText(code, reason);
    this.hooks.closed(why, again);
    if (!again) return;
    this.next = setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(kLatest, 2 * this.wait);
  }
}

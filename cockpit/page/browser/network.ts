// A network between a page and the run, whose cable can be pulled out: nothing passes any more, and nobody is told.
import { connect, createServer, type AddressInfo, type Server, type Socket } from "node:net";

export class Network {
  private readonly sockets: Socket[] = [];
  private isCut = false;

  private constructor(
    private readonly server: Server,
    readonly url: string,
  ) {}

  static async to(run: string): Promise<Network> {
    const target = new URL(run);
    const server = createServer();
    await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
    const url = new URL(run);
    url.port = String((server.address() as AddressInfo).port);
    const network = new Network(server, url.href);
    server.on("connection", (near) => network.join(near, Number(target.port)));
    return network;
  }

  cut(): void {
    this.isCut = true;
  }

  /** Connections that were cut are lost; new ones pass. */
  repair(): void {
    for (const socket of this.sockets.splice(0)) socket.destroy();
    this.isCut = false;
  }

  end(): void {
    for (const socket of this.sockets) socket.destroy();
    this.server.close();
  }

  private join(near: Socket, port: number): void {
    const far = connect(port, "127.0.0.1");
    for (const [from, to] of [
      [near, far],
      [far, near],
    ] as const) {
      this.sockets.push(from);
      from.on("data", (bytes) => this.isCut || to.write(bytes));
      from.on("error", () => {});
      from.on("close", () => this.isCut || to.destroy());
    }
  }
}

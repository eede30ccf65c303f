// The state in the address: reload or send the link, and the same picture comes back.

import type { Compare } from "./compare";
import type { State } from "./state";
import type { Scene } from "./types";
import type { Pose } from "./view/orbit";

/** What a link holds. */
export interface Shared {
  state?: State;
  pose?: Pose;
  view?: { inside?: string; number?: number; flat?: boolean; seams?: boolean; compare?: Compare["shared"]; light?: number };
  /** A scene, or a part of one, as text in the address. */
  scene?: Partial<Scene>;
}

const PREFIX = "#s=";

async function through(bytes: BufferSource, stream: CompressionStream | DecompressionStream): Promise<Uint8Array<ArrayBuffer>> {
  const body = new Blob([bytes]).stream().pipeThrough(stream as ReadableWritablePair<Uint8Array<ArrayBuffer>, Uint8Array<ArrayBuffer>>);
  return new Uint8Array(await new Response(body).arrayBuffer());
}

/** The fragment of an address that holds `shared`. */
export async function writeHash(shared: Shared): Promise<string> {
  const bytes = await through(new TextEncoder().encode(JSON.stringify(shared)), new CompressionStream("deflate-raw"));
  const text = Array.from(bytes, (byte) => String.fromCharCode(byte)).join("");
  return PREFIX + btoa(text).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "");
}

/** What a fragment holds; null when it is empty. `#scene={…}` may hold plain JSON. Throws when it is damaged. */
export async function readHash(hash: string): Promise<Shared | null> {
  if (hash.startsWith("#scene=")) return { scene: JSON.parse(decodeURIComponent(hash.slice(7))) };
  if (!hash.startsWith(PREFIX)) return null;
  return unpacked(hash).catch(() => {
    throw new Error("A part of the link is missing or was changed on its way. Copy it again as a whole.");
  });
}

async function unpacked(hash: string): Promise<Shared> {
  const text = atob(hash.slice(PREFIX.length).replace(/-/g, "+").replace(/_/g, "/"));
  const bytes = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  return JSON.parse(new TextDecoder().decode(await through(bytes, new DecompressionStream("deflate-raw"))));
}

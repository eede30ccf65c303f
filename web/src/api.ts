// HTTP: problems told as they are, stale requests aborted, long work as a job.

import type { Asset, Preset, Profile, Scene, Showing } from "./types";

/** One fault of a request: where in the scene, and what. */
export interface FieldError {
  pointer: string;
  detail: string;
}

/** An answer of the service that is not a success (RFC 9457). */
export class Problem extends Error {
  constructor(
    readonly status: number,
    readonly slug: string,
    readonly title: string,
    detail: string,
    readonly errors: FieldError[] = [],
    readonly retryAfter = 0,
  ) {
    super(detail);
  }
}

/** The service can't be reached. */
export class Offline extends Error {}

/** A name for one who asks for drafts: a newer one takes the place of its older ones. */
export const clientName = (): string => `page-${crypto.getRandomValues(new Uint32Array(2)).join("-")}`;

async function ask(url: string, init: RequestInit): Promise<Response> {
  let response: Response;
  try {
    const coming = await fetch(url, init);
    const { status, statusText, headers } = coming;
    const body = status === 204 ? null : await coming.arrayBuffer(); // one that breaks off is no answer
    response = new Response(body, { status, statusText, headers });
  } catch (error) {
    if (init.signal?.aborted) throw error;
    throw new Offline("The service can't be reached.");
  }
  if (response.ok) return response;
  throw await problemOf(response);
}

async function problemOf(response: Response): Promise<Problem> {
  const wait = Number(response.headers.get("retry-after") ?? 0);
  const body = await response.json().catch(() => ({}));
  const slug = String(body.type ?? "").split("/").pop() || "unknown";
  const detail = String(body.reason ?? body.detail ?? response.statusText);
  return new Problem(response.status, slug, String(body.title ?? "Something went wrong"), detail, body.errors ?? [], wait);
}

interface Options {
  signal?: AbortSignal;
  accept?: string;
  /** Whose draft this is. */
  client?: string;
  progress?: (stage: string, fraction: number) => void;
}

/** What was asked before the one who needs it is there. */
interface Begun {
  answer: Promise<Response>;
  abort: AbortController;
  progress?: Options["progress"];
}

const begun = new Map<string, Begun>();

const named = (url: string, scene: object, { accept = "" }: Options): string => `${url} ${accept} ${JSON.stringify(scene)}`;

/** Asks already; the same request gets this answer, once. */
export function ahead(url: string, scene: object, options: Options = {}): void {
  const one: Partial<Begun> = { abort: new AbortController() };
  const progress = options.progress && ((stage: string, fraction: number) => one.progress?.(stage, fraction));
  one.answer = post(url, scene, { ...options, progress, signal: one.abort!.signal });
  one.answer.catch(() => undefined); // the one who needs it hears
  begun.set(named(url, scene, options), one as Begun);
}

/** The answer that was asked for ahead, as if it were asked for now. */
function taken(url: string, scene: object, options: Options): Promise<Response> | null {
  const name = named(url, scene, options);
  const one = begun.get(name);
  if (!one || options.client) return null;
  begun.delete(name);
  one.progress = options.progress;
  const { signal } = options;
  signal?.addEventListener("abort", () => one.abort.abort(signal.reason));
  return one.answer;
}

/** POSTs a scene; work that waits for its turn or a full queue is asked for again. */
async function post(url: string, scene: object, options: Options = {}): Promise<Response> {
  const early = taken(url, scene, options);
  if (early) return early;
  const headers: Record<string, string> = { "content-type": "application/json" };
  if (options.accept) headers.accept = options.accept;
  if (options.client) headers["x-client-id"] = options.client;
  if (options.progress) headers.prefer = "respond-async, wait=1"; // a job only where progress is worth showing
  const body = JSON.stringify(scene);
  for (let tries = 0; ; tries++) {
    try {
      const response = await ask(url, { method: "POST", headers, body, signal: options.signal });
      return response.status === 202 ? await finished(response, options) : response;
    } catch (error) {
      const wait = error instanceof Problem && error.retryAfter && tries < 8 ? error.retryAfter : 0;
      if (!wait || (error as Problem).slug === "render-timeout") throw error;
      await sleep(Math.min(wait, 2) * 1000, options.signal);
    }
  }
}

/** Follows a job by its events; gives its result. An abort cancels it. */
async function finished(accepted: Response, options: Options): Promise<Response> {
  const links = (await accepted.json()).links as { self: string; events: string; result: string };
  const events = new EventSource(links.events);
  try {
    await new Promise<void>((done, fail) => {
      const hear = (event: MessageEvent) => {
        const job = JSON.parse(event.data);
        options.progress?.(job.stage, job.fraction);
      };
      events.addEventListener("progress", hear);
      for (const end of ["done", "failed", "cancelled", "stopping"]) events.addEventListener(end, () => done());
      // the browser would go on asking for ever
      const gone = () => fail(new Offline("The service can't be reached."));
      events.onerror = () => {
        if (events.readyState === EventSource.CLOSED) gone();
        else fetch(links.self).catch(gone); // the browser itself would go on asking for ever
      };
      options.signal?.addEventListener("abort", () => fail(options.signal?.reason));
    });
  } catch (error) {
    void fetch(links.self, { method: "DELETE" }).catch(() => undefined);
    throw error;
  } finally {
    events.close();
  }
  return ask(links.result, { signal: options.signal });
}

export function sleep(ms: number, signal?: AbortSignal): Promise<void> {
  return new Promise((done, fail) => {
    const timer = setTimeout(done, ms);
    signal?.addEventListener("abort", () => (clearTimeout(timer), fail(signal.reason)));
  });
}

export const GLB = "model/gltf-binary";
export const PNG = "image/png";
/** Images as half floats. */
export const NPY = "application/x-npy";

/** Where parts of a scene are asked for. */
export const ASKED = {
  geometry: "/v1/geometry",
  showing: "/v1/showing",
  map: (name: string): string => `/v1/map?name=${encodeURIComponent(name)}`,
  image: (image: string): string => `/v1/render?image=${image}`,
};

export const api = {
  async ready(): Promise<boolean> {
    try {
      return (await fetch("/readyz", { cache: "no-store" })).ok;
    } catch {
      throw new Offline("The service can't be reached.");
    }
  },
  async scenes(): Promise<{ name: string; summary: string; scene: Scene }[]> {
    return (await ask("/v1/scenes", {})).json();
  },
  async presets(signal?: AbortSignal): Promise<Preset[]> {
    return (await ask("/v1/presets", { signal })).json();
  },
  async showing(scene: object, options?: Options): Promise<Showing> {
    return (await post(ASKED.showing, scene, options)).json();
  },
  async geometry(scene: object, options?: Options): Promise<ArrayBuffer> {
    return (await post(ASKED.geometry, scene, { ...options, accept: GLB })).arrayBuffer();
  },
  async map(scene: object, name: string, options?: Options): Promise<Blob> {
    return (await post(ASKED.map(name), scene, { ...options, accept: PNG })).blob();
  },
  async image(scene: object, image: string, options?: Options): Promise<Response> {
    const quality = options?.client ? "&quality=draft" : "";
    return post(`${ASKED.image(image)}${quality}`, scene, options);
  },
  async bake(scene: object, options?: Options): Promise<Blob> {
    return (await post("/v1/bake", scene, { ...options, accept: GLB })).blob();
  },
  async profile(scene: object, options?: Options): Promise<Profile> {
    return (await post("/v1/profile", scene, options)).json();
  },
  async inspect(scene: object, options?: Options): Promise<{ advice: string[] }> {
    return (await post("/v1/inspect", scene, options)).json();
  },
  /** What is kept under a sha256. */
  async asset(sha256: string): Promise<Asset> {
    return (await ask(`/v1/assets/${sha256}`, {})).json();
  },
  async upload(file: File, signal?: AbortSignal): Promise<Asset> {
    const url = `/v1/assets?name=${encodeURIComponent(file.name)}`;
    const headers = { "content-type": "application/octet-stream" };
    return (await ask(url, { method: "POST", headers, body: file, signal })).json();
  },
};

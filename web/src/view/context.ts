// The canvas and its WebGL context; free of all else, so that they are there before what draws.

export interface Prepared {
  canvas: HTMLCanvasElement;
  context: WebGL2RenderingContext | undefined;
  /** No graphics card draws. */
  slow: boolean;
}

/** Whether no graphics card draws: then every pixel and every triangle costs. */
function isSoftware(gl: WebGL2RenderingContext | null): boolean {
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl && info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

let made: Prepared | null = null;

/** The canvas of the page with its context, made once. */
export const prepared = (canvas: HTMLCanvasElement): Prepared => (made ??= make(canvas));

function make(canvas: HTMLCanvasElement): Prepared {
  // opaque, so that the browser need not draw what lies behind, nor blend
  const options = { alpha: false, powerPreference: "high-performance" } as const;
  const coarse = canvas.getContext("webgl2", { ...options, antialias: false });
  if (isSoftware(coarse)) return { canvas, context: coarse!, slow: true };
  // another canvas takes its place, whose edges a graphics card smooths
  coarse?.getExtension("WEBGL_lose_context")?.loseContext();
  const smooth = canvas.cloneNode() as HTMLCanvasElement;
  canvas.replaceWith(smooth);
  return { canvas: smooth, context: smooth.getContext("webgl2", { ...options, antialias: true }) ?? undefined, slow: false };
}

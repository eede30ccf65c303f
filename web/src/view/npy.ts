// NumPy's .npy as the service sends it: half floats (H, W, C), C order.

export interface HalfImage {
  width: number;
  height: number;
  channels: number;
  /** Half-float bits, row-major. */
  data: Uint16Array;
}

/** The image in the bytes of a .npy. Throws when it is anything else. */
export function parseNpy(buffer: ArrayBuffer): HalfImage {
  const view = new DataView(buffer);
  if (view.getUint32(0) !== 0x934e554d || view.getUint16(4) !== 0x5059) throw new Error("not an .npy file");
  const length = view.getUint16(8, true);
  const header = new TextDecoder("latin1").decode(new Uint8Array(buffer, 10, length));
  const shape = /'shape': \((\d+), (\d+), (\d+)\)/.exec(header);
  if (!header.includes("'<f2'") || !header.includes("False") || !shape) throw new Error("not a half-float image");
  const [height, width, channels] = shape.slice(1).map(Number);
  return { width, height, channels, data: new Uint16Array(buffer, 10 + length) };
}

const TABLE = new Float32Array(65536);
for (let bits = 0; bits < 65536; bits++) {
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  const size = exponent === 0 ? fraction * 2 ** -24 : (1 + fraction / 1024) * 2 ** (exponent - 15);
  TABLE[bits] = exponent === 31 ? NaN : bits & 0x8000 ? -size : size;
}

/** The number that half-float bits stand for. */
export const half = (bits: number): number => TABLE[bits];

/** The half-float bits nearest to a number in 0..1. */
export function toHalf(value: number): number {
  let low = 0;
  let high = 0x3c00; // positive halves sort as their bits do
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (TABLE[middle] <= value) low = middle;
    else high = middle;
  }
  return TABLE[high] - value < value - TABLE[low] ? high : low;
}

const ONE = 0x3c00;

/** The image as RGBA half floats; grey goes into all colours. */
export function rgba(image: HalfImage): Uint16Array<ArrayBuffer> {
  const { data, channels } = image;
  const count = image.width * image.height;
  const out = new Uint16Array(count * 4);
  for (let i = 0, from = 0, to = 0; i < count; i++, from += channels, to += 4) {
    out[to] = data[from];
    out[to + 1] = channels > 1 ? data[from + 1] : data[from];
    out[to + 2] = channels > 2 ? data[from + 2] : data[from];
    out[to + 3] = ONE;
  }
  return out;
}

/** Least and greatest value. */
export function rangeOf({ data }: HalfImage): { low: number; high: number } {
  let low = Infinity;
  let high = -Infinity;
  for (const bits of data) {
    const value = TABLE[bits];
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return { low, high };
}

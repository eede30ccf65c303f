// Which lights reach which places, for highlights: depths as the first lights see them, drawn when they move.

import {
  type BufferGeometry,
  DepthTexture,
  DoubleSide,
  LessEqualCompare,
  LinearFilter,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  PerspectiveCamera,
  type Sphere,
  Vector3,
  type Vector4,
  WebGLRenderTarget,
  type WebGLRenderer,
} from "three";
import type { Beam } from "./look";

/** How many lights cast shadows: each has a tile of one texture. */
export const MOST = 4;

const TILES = 2; // along an edge
const TILE = 512; // texels
const LIFT = 0.02; // of the radius, by which a place is taken to be nearer: highlights forgive it, stripes show
const FARTHEST = 60; // radii to distant lights: as good as parallel

export class Shadows {
  readonly uniforms = {
    shadowMap: { value: null as DepthTexture | null },
    shadowMatrix: { value: Array.from({ length: MOST }, () => new Matrix4()) },
  };
  private readonly target: WebGLRenderTarget;
  private readonly drawn: string[] = []; // where the light of each tile stands
  private geometry: BufferGeometry | null = null;
  private readonly mesh = new Mesh(undefined, new MeshBasicMaterial({ side: DoubleSide, colorWrite: false }));

  constructor() {
    const depth = new DepthTexture(TILES * TILE, TILES * TILE);
    depth.compareFunction = LessEqualCompare;
    depth.minFilter = depth.magFilter = LinearFilter; // four comparisons, weighed
    this.target = new WebGLRenderTarget(TILES * TILE, TILES * TILE, { depthTexture: depth, generateMipmaps: false });
    this.target.scissorTest = true;
    this.uniforms.shadowMap.value = depth;
    this.mesh.frustumCulled = false;
  }

  /** Draws the tiles whose light moved; how many there are. `geometry` casts the shadows. */
  update(renderer: WebGLRenderer, geometry: BufferGeometry, beams: Beam[]): number {
    if (geometry !== this.geometry) this.drawn.length = 0;
    this.geometry = this.mesh.geometry = geometry;
    const count = Math.min(beams.length, MOST);
    for (let i = 0; i < count; i++) {
      const key = beams[i].place.toArray().join(" ");
      if (this.drawn[i] === key) continue;
      this.drawn[i] = key;
      this.draw(renderer, i, seeing(beams[i].place, geometry.boundingSphere!));
    }
    return count;
  }

  /** Everything is to be drawn again, as when the graphics card forgot it. */
  forget(): void {
    this.drawn.length = 0;
  }

  private draw(renderer: WebGLRenderer, i: number, camera: PerspectiveCamera | null): void {
    const matrix = this.uniforms.shadowMatrix.value[i];
    matrix.elements.fill(0); // all is lit
    if (!camera) return;
    const [column, row] = [i % TILES, Math.floor(i / TILES)];
    this.target.viewport.set(column * TILE, row * TILE, TILE, TILE);
    this.target.scissor.copy(this.target.viewport);
    renderer.setRenderTarget(this.target);
    renderer.render(this.mesh, camera);
    renderer.setRenderTarget(null);
    // from -1..1 to the tile
    matrix.makeTranslation((column + 0.5) / TILES, (row + 0.5) / TILES, 0.5 - LIFT / 2);
    matrix.scale(new Vector3(0.5 / TILES, 0.5 / TILES, 0.5));
    matrix.multiply(camera.projectionMatrix).multiply(camera.matrixWorldInverse);
  }
}

/** What a light sees of the sphere; null: it stands in it. */
function seeing(place: Vector4, { center, radius }: Sphere): PerspectiveCamera | null {
  const eye = new Vector3(place.x, place.y, place.z);
  if (!place.w) eye.multiplyScalar(FARTHEST * radius).add(center);
  const distance = eye.distanceTo(center);
  if (distance < 1.05 * radius) return null;
  const angle = 2 * Math.asin(radius / distance);
  const camera = new PerspectiveCamera((angle * 180) / Math.PI, 1, distance - radius, distance + radius);
  camera.position.copy(eye);
  if (Math.abs(eye.x - center.x) + Math.abs(eye.z - center.z) < 1e-3 * distance) camera.up.set(1, 0, 0);
  camera.lookAt(center);
  camera.updateMatrixWorld();
  return camera;
}

// The camera's place, moved by mouse, touch and keys; and the drag that moves the light instead.

import { MathUtils, type PerspectiveCamera, Vector3 } from "three";

/** Where the camera stands. */
export interface Pose {
  position_mm: [number, number, number];
  target_mm: [number, number, number];
  fov_y_deg: number;
}

export interface OrbitEvents {
  moved(): void;
  rested(): void;
  /** The light turns by these angles around the camera's up and right [radians]. */
  light(yaw: number, pitch: number): void;
  lightDone(): void;
}

const LIMIT = 1.55;
const KEY_STEP = 0.09;

export class Orbit {
  readonly target = new Vector3();
  private yaw = 0;
  private pitch = 0;
  private distance = 1;
  private radius = 1;
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private mode: "orbit" | "pan" | "light" | null = null;

  constructor(
    readonly camera: PerspectiveCamera,
    private readonly element: HTMLElement,
    private readonly events: OrbitEvents,
  ) {
    element.addEventListener("pointerdown", (event) => this.down(event));
    element.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"] as const) element.addEventListener(end, (event) => this.up(event));
    element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    element.addEventListener("keydown", (event) => this.key(event));
    element.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  get pose(): Pose {
    return {
      position_mm: this.camera.position.toArray(),
      target_mm: this.target.toArray(),
      fov_y_deg: this.camera.fov,
    };
  }

  /** `radius` [mm] of the object: how far zoom and the clipping planes reach. */
  set(pose: Pose, radius: number): void {
    this.radius = radius;
    this.target.fromArray(pose.target_mm);
    const offset = new Vector3().fromArray(pose.position_mm).sub(this.target);
    this.distance = offset.length();
    this.yaw = Math.atan2(offset.x, offset.z);
    this.pitch = Math.asin(MathUtils.clamp(offset.y / this.distance, -1, 1));
    this.camera.fov = pose.fov_y_deg;
    this.apply();
  }

  /** `radius` [mm] of another object, which stands where the camera looks. */
  reach(radius: number): void {
    this.radius = radius;
    this.apply();
  }

  turn(yaw: number, pitch = 0): void {
    this.yaw += yaw;
    this.pitch = MathUtils.clamp(this.pitch + pitch, -LIMIT, LIMIT);
    this.apply();
  }

  private zoom(factor: number): void {
    this.distance = MathUtils.clamp(this.distance * factor, this.radius * 0.3, this.radius * 40);
    this.apply();
  }

  private pan(x: number, y: number): void {
    const scale = (2 * this.distance * Math.tan(MathUtils.degToRad(this.camera.fov / 2))) / this.element.clientHeight;
    const right = new Vector3().setFromMatrixColumn(this.camera.matrix, 0);
    const up = new Vector3().setFromMatrixColumn(this.camera.matrix, 1);
    this.target.addScaledVector(right, -x * scale).addScaledVector(up, y * scale);
    this.apply();
  }

  apply(): void {
    const flat = Math.cos(this.pitch);
    const away = new Vector3(Math.sin(this.yaw) * flat, Math.sin(this.pitch), Math.cos(this.yaw) * flat);
    this.camera.position.copy(this.target).addScaledVector(away, this.distance);
    this.camera.near = Math.max(this.distance - 4 * this.radius, this.distance * 0.01);
    this.camera.far = this.distance + 6 * this.radius;
    this.camera.lookAt(this.target);
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    this.events.moved();
  }

  private down(event: PointerEvent): void {
    this.element.focus({ preventScroll: true });
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size > 1) this.mode = "light";
    else if (event.shiftKey) this.mode = "light";
    else if (event.button === 1 || event.button === 2 || event.ctrlKey || event.metaKey) this.mode = "pan";
    else this.mode = "orbit";
  }

  private move(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    if (!before || !this.mode) return;
    const spreadBefore = this.spread();
    const now = { x: event.clientX, y: event.clientY };
    const share = 1 / this.pointers.size;
    const dx = (now.x - before.x) * share;
    const dy = (now.y - before.y) * share;
    this.pointers.set(event.pointerId, now);
    if (this.pointers.size > 1 && spreadBefore > 0) this.zoom(spreadBefore / this.spread());
    const speed = Math.PI / Math.min(this.element.clientWidth, this.element.clientHeight);
    if (this.mode === "light") this.events.light(dx * speed, dy * speed);
    else if (this.mode === "pan") this.pan(dx, dy);
    else this.turn(-dx * speed, dy * speed);
  }

  private up(event: PointerEvent): void {
    if (!this.pointers.delete(event.pointerId)) return;
    if (this.pointers.size) return;
    if (this.mode === "light") this.events.lightDone();
    else this.events.rested();
    this.mode = null;
  }

  private spread(): number {
    const [a, b] = [...this.pointers.values()];
    return b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.zoom(Math.exp(MathUtils.clamp(event.deltaY * (event.deltaMode ? 20 : 1), -200, 200) * 0.0015));
    this.events.rested();
  }

  private key(event: KeyboardEvent): void {
    const steps: Record<string, [number, number]> = {
      ArrowLeft: [-1, 0],
      ArrowRight: [1, 0],
      ArrowUp: [0, -1],
      ArrowDown: [0, 1],
    };
    const step = steps[event.key];
    if (step && !event.ctrlKey && !event.metaKey && !event.altKey) {
      const [x, y] = step.map((value) => value * KEY_STEP);
      if (event.shiftKey) {
        this.events.light(x, y);
        this.events.lightDone();
      } else {
        this.turn(x, -y);
        this.events.rested();
      }
    } else if (event.key === "+" || event.key === "=" || event.key === "-") {
      this.zoom(event.key === "-" ? 1.1 : 1 / 1.1);
      this.events.rested();
    } else return;
    event.preventDefault();
  }
}

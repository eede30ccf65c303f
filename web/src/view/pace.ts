// When frames are drawn, and how finely: whole at rest; where that takes long, quickly while things move.

const LATE_MS = 40; // a frame that took longer is late
const PATIENCE = 3; // late frames, one after the other, until frames are drawn quickly
const EASE = 60; // quick frames in time, one after the other, until frames are drawn whole again
const GOAL_MS = 28;
const REST_MS = 200; // after the last movement
const COARSEST = 0.3; // of the pixels along an edge
const STEP = 1.12; // a smaller change is not worth new buffers

export class Pace {
  private dirty = true;
  private before = 0;
  private late = 0;
  private movedAt = -Infinity;
  private asked = false; // for a frame of a movement, which is owed however late it comes
  private early = 0;
  private quickly = false; // how the frame on screen was drawn
  /** Of the pixels along an edge, in frames that are drawn quickly. */
  share = 0.6;

  slow: boolean;

  /** `known`: frames take long, as is known from the start. */
  constructor(
    private readonly known: boolean,
    private readonly draw: (quickly: boolean) => void,
    private readonly turnedSlow: () => void,
  ) {
    this.slow = known;
    requestAnimationFrame(this.step);
  }

  /** Asks for a frame; `moving`: more will follow. */
  ask(moving: boolean): void {
    this.dirty = true;
    if (!moving) return;
    this.asked = true;
    this.movedAt = performance.now();
  }

  private readonly step = (now: number): void => {
    const moving = this.asked || now - this.movedAt < REST_MS;
    if (this.dirty) {
      if (this.before) this.judge(now - this.before);
      this.before = now;
      this.paint(this.slow && moving);
    } else {
      this.before = 0;
      if (this.quickly && !moving) this.paint(false);
    }
    requestAnimationFrame(this.step);
  };

  private paint(quickly: boolean): void {
    this.dirty = this.asked = false;
    this.quickly = quickly;
    this.draw(quickly);
  }

  private judge(took: number): void {
    if (!this.slow) {
      this.late = took > LATE_MS ? this.late + 1 : 0;
      this.slow = this.late >= PATIENCE;
      if (this.slow) this.turnedSlow();
    } else if (this.quickly) {
      this.early = this.share === 1 && took < GOAL_MS ? this.early + 1 : 0;
      if (this.early >= EASE && !this.known) this.slow = false; // it was a hiccup
      // time goes with pixels
      const factor = Math.max(Math.sqrt(GOAL_MS / took), 0.7);
      const wanted = Math.min(Math.max(this.share * factor, COARSEST), 1);
      if (wanted > this.share * STEP || wanted < this.share / STEP) this.share = wanted;
    }
  }
}

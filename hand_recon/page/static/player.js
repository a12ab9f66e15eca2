// Hands of a file, frame by frame, beside their video where there is one.

import { asked } from "./requests.js";

const BLOCK = 40;

export class Player {
  constructor({ play, slider, label, video }, onFrame, onError) {
    Object.assign(this, { play, slider, label, video, onFrame, onError });
    // Hands are played by themselves beside a video that this browser does not play.
    video.addEventListener("error", () => {
      if (!this.result) return;
      this.hasVideo = this.result.hasVideo = false;
      video.hidden = true;
      this.go(this.frame, false);
    });
    play.addEventListener("click", () => this.isPlaying ? this.pause() : this.start());
    slider.addEventListener("input", () => { this.pause(); this.go(Number(slider.value), true); });
  }

  open(result, hasVideo) {
    this.pause();
    this.result = result;
    this.hasVideo = hasVideo;
    this.blocks = new Map();
    this.known = new Map(result.first.map((views, frame) => [frame, views]));
    this.slider.max = result.frames.length - 1;
    this.play.hidden = result.kind !== "clip";
    this.go(0, true);
  }

  close() {
    this.pause();
    this.result = null;
  }

  start() {
    if (!this.result) return;
    this.isPlaying = true;
    this.play.textContent = "Pause";
    const { frames } = this.result;
    if (this.frame >= frames.length - 1) this.go(0, true);
    if (this.hasVideo) this.video.play();
    this.begun = performance.now() - 1000 * frames[this.frame].time;
    requestAnimationFrame(() => this.tick());
  }

  pause() {
    this.isPlaying = false;
    this.play.textContent = "Play";
    if (this.hasVideo) this.video.pause();
  }

  tick() {
    if (!this.isPlaying || !this.result) return;
    const { frames } = this.result;
    const now = this.hasVideo ? this.video.currentTime : (performance.now() - this.begun) / 1000;
    let next = this.frame;
    while (next + 1 < frames.length && frames[next + 1].time <= now + 1e-3) next++;
    if (next !== this.frame) this.go(next, false);
    const isOver = this.hasVideo ? this.video.ended : next === frames.length - 1;
    if (isOver) this.pause();
    else requestAnimationFrame(() => this.tick());
  }

  async go(frame, seek) {
    this.frame = frame;
    const { result } = this;
    const { label, time } = result.frames[frame];
    this.slider.value = frame;
    this.label.textContent = result.kind === "clip" ? `${label} · ${time.toFixed(2)} s` : `${label} (${frame + 1} of ${result.frames.length})`;
    if (seek && this.hasVideo) this.video.currentTime = time;
    try {
      const views = await this.views(frame);
      if (this.result !== result) return;
      if (this.frame === frame) this.onFrame(views, frame);
      if (frame + BLOCK / 2 < result.frames.length) await this.views(frame + BLOCK / 2);
    } catch (error) {
      this.blocks.clear();
      if (this.result !== result) return;
      this.pause();
      this.onError(error.message);
    }
  }

  async views(frame) {
    if (this.known.has(frame)) return this.known.get(frame);
    const first = BLOCK * Math.floor(frame / BLOCK);
    if (!this.blocks.has(first)) {
      this.blocks.set(first, asked(`api/frames/${this.result.id}?first=${first}&count=${BLOCK}`));
    }
    const found = await this.blocks.get(first);
    found.forEach((views, place) => this.known.set(first + place, views));
    return this.known.get(frame) ?? [];
  }
}

// The webcam: one image is sent, and the next only when its hands have come back.

const WIDTH = 640;
const ENDED = "The server ended the webcam's connection; expected it to go on. See whether hand-recon demo still runs, and start the webcam again.";

export class Webcam {
  constructor(video, { onHands, onEnd }) {
    this.video = video;
    this.onHands = onHands;
    this.onEnd = onEnd;
    this.canvas = document.createElement("canvas");
  }

  get isOn() {
    return Boolean(this.stream);
  }

  async start() {
    if (!navigator.mediaDevices) {
      throw new Error("This page cannot use a camera: browsers allow it at http://127.0.0.1 or http://localhost alone. Open the page there.");
    }
    try {
      this.stream = await navigator.mediaDevices.getUserMedia({ video: { width: { ideal: WIDTH }, height: { ideal: 480 } } });
    } catch (error) {
      throw new Error(`The camera cannot be used (${error.name}); expected permission and a camera that is free. Allow it in the address bar.`);
    }
    this.video.srcObject = this.stream;
    await this.video.play();
    const socket = new WebSocket(`${location.origin.replace("http", "ws")}/api/live`);
    this.socket = socket;
    this.times = [];
    socket.addEventListener("open", () => this.send());
    socket.addEventListener("message", (event) => this.answered(JSON.parse(event.data)));
    socket.addEventListener("close", () => { if (this.socket === socket) this.stop(this.refusal ?? ENDED); });
  }

  // The image is sent as the camera has it; only the display is mirrored.
  async send() {
    const blob = await this.image(WIDTH, 0.8);
    if (this.socket?.readyState === WebSocket.OPEN && blob) this.socket.send(blob);
  }

  image(most, quality) {
    const { videoWidth, videoHeight } = this.video;
    const scale = Math.min(1, most / Math.max(videoWidth, videoHeight, 1));
    this.canvas.width = Math.round(scale * videoWidth);
    this.canvas.height = Math.round(scale * videoHeight);
    this.canvas.getContext("2d").drawImage(this.video, 0, 0, this.canvas.width, this.canvas.height);
    return new Promise((resolve) => this.canvas.toBlob(resolve, "image/jpeg", quality));
  }

  answered(found) {
    if (!this.isOn) return;
    if (found.error) {
      this.refusal = found.error;
      this.stop(found.error);
      return;
    }
    this.times = [...this.times, performance.now()].slice(-20);
    const rate = this.times.length > 1 ? 1000 * (this.times.length - 1) / (this.times.at(-1) - this.times[0]) : 0;
    this.onHands(found, rate);
    const next = () => this.send();
    // A hidden page gets no frames, and need not send any.
    if (this.video.requestVideoFrameCallback) this.video.requestVideoFrameCallback(next);
    else requestAnimationFrame(next);
  }

  stop(error) {
    if (!this.isOn) return;
    this.stream.getTracks().forEach((track) => track.stop());
    this.stream = null;
    this.refusal = undefined;
    const { socket } = this;
    this.socket = null;
    socket?.close();
    this.video.srcObject = null;
    this.onEnd(error);
  }
}

// The page: what is open, what is shown of it, and the buttons.

import { asked, sent } from "./requests.js";
import { drawOverlay, shownPlane } from "./overlay.js";
import { HandScene } from "./scene.js";
import { cameraSentence, fillDownloads, fillHands, fillRows, made, rowSentence } from "./facts.js";
import { listenForFiles } from "./dropping.js";
import { Player } from "./player.js";
import { Webcam } from "./webcam.js";

const at = (id) => document.getElementById(id);
const state = { result: null, row: null, which: null, views: [], size: null, work: 0 };
let about, scene;

const player = new Player(
  { play: at("play"), slider: at("frame"), label: at("frame-label"), video: at("video") },
  (views, frame) => showViews(views, { isNew: frame === 0 && !state.views.length, animate: false }),
  tell,
);
const webcam = new Webcam(at("video"), { onHands: showLive, onEnd: liveEnded });

// --- Files -----------------------------------------------------------------------------------------------

async function work(task, words) {
  const number = ++state.work;
  tell("");
  at("working").hidden = false;
  at("status").textContent = words;
  const begun = performance.now();
  try {
    const result = await task();
    if (number === state.work) {
      open(result);
      at("status").textContent = `${result.name} · ${((performance.now() - begun) / 1000).toFixed(1)} s`;
    }
  } catch (error) {
    if (number === state.work) {
      at("status").textContent = "";
      tell(error.message);
    }
  } finally {
    if (number === state.work) at("working").hidden = true;
  }
}

function openFile(file) {
  const most = about?.bounds.file_bytes ?? Infinity;
  webcam.stop();
  // The server has the same bound; this saves the upload.
  if (file.size > most) {
    tell(`${file.name} has ${(file.size / 1e6).toFixed(1)} MB; expected at most ${most / 1e6} MB. Scale the photograph down, or start the page with a larger bounds.megabytes.`);
    return;
  }
  work(() => sent(file.name, file), `Working on ${file.name}…`);
}

function tell(sentence) {
  at("error").textContent = sentence;
  at("error").hidden = !sentence;
}

// --- Results ---------------------------------------------------------------------------------------------

function open(result) {
  player.close();
  webcam.stop();
  at("live").hidden = true;
  Object.assign(state, { result, views: [], size: result.image ? [result.image.width, result.image.height] : null });
  at("views").classList.remove("is-empty");
  at("empty").hidden = true;
  at("photo").hidden = !result.image;
  if (result.image) Object.assign(at("photo"), { src: result.image.url, alt: `The photograph ${result.name}` });
  const isPlayed = Boolean(result.frames);
  at("player").hidden = !isPlayed;
  at("ladder").hidden = isPlayed || !Object.keys(result.rows ?? {}).length;
  const isEmpty = !isPlayed && !Object.keys(result.rows).length;
  at("facts").hidden = at("photo-options").hidden = false;
  at("scene-options").hidden = at("legend").hidden = isEmpty;
  if (isEmpty || scene.isMissing) at("scene-empty").textContent = isEmpty ? "No hand, and so nothing to rotate" : "No WebGL, and so no 3D view";
  at("scene-empty").hidden = !(isEmpty || scene.isMissing);
  at("which-label").hidden = true;
  state.which = null;
  at("notes").replaceChildren(...(result.notes ?? []).map((note) => made("li", note)));
  at("show-ghost").closest("label").hidden = isPlayed;
  showVideo(isPlayed && result.hasVideo);
  if (isPlayed) {
    state.row = "file";
    player.open(result, result.hasVideo);
  } else {
    const keys = Object.keys(result.rows);
    // The best hand comes first, the others while it is looked at.
    state.row = keys.at(-1) ?? null;
    offerHands(result.image ? [] : result.rows[state.row] ?? []);
    showRow(true);
    if (keys.length) fitRows(result);
  }
}

// Hands of a file of landmarks need not be of one image, and are shown one at a time.
function offerHands(views) {
  state.which = views.length > 1 ? 0 : null;
  at("which-label").hidden = state.which === null;
  at("which").replaceChildren(...views.map((view, place) => new Option(`${place + 1} of ${views.length}: ${view.entry.name}`, place)));
}

function chosen(views = []) {
  return state.which === null ? views : views.slice(state.which, state.which + 1);
}

async function fitRows(result) {
  try {
    result.rows = await asked(`api/rows/${result.id}`);
  } catch (error) {
    if (state.result === result) tell(error.message);
    return;
  }
  if (state.result === result) showRow(false);
}

function showVideo(isShown) {
  const video = at("video");
  at("stage").classList.remove("is-mirrored");
  video.hidden = !isShown;
  if (isShown) video.src = "api/video";
  else video.removeAttribute("src");
}

function showRow(isNew) {
  const { result, row } = state;
  const views = chosen(result.rows[row]);
  const number = about.rows.findIndex((one) => one.key === row);
  if (views.length) {
    const rows = Object.fromEntries(Object.entries(result.rows).map(([key, all]) => [key, chosen(all)]));
    fillRows(at("rows"), about.rows, rows, row, choose);
    at("row-sentence").textContent = rowSentence(about.rows[number], views, number);
  }
  showViews(views, { isNew, animate: !isNew });
}

function choose(row) {
  state.row = row;
  showRow(false);
  // The buttons were made anew, and the focus stays.
  document.querySelector(`#rows input[value="${row}"]`).focus();
}

function showViews(views, { isNew = false, animate = true } = {}) {
  const { result } = state;
  state.views = views;
  const number = about.rows.findIndex((one) => one.key === state.row);
  const before = at("show-ghost").checked ? chosen(result?.rows?.[about.rows[number - 1]?.key]) : [];
  const hasCovariance = views.some((view) => view.entry.covariance_3d);
  at("ellipsoids-label").hidden = !hasCovariance;
  scene.show(views, { ghosts: before, ellipsoids: hasCovariance && at("show-ellipsoids").checked, isNew, animate });
  overlay();
  fillHands(at("hands"), views);
  at("camera").textContent = cameraSentence(views, state.size !== null || Boolean(result?.frames));
  const isKept = Boolean(result) && views.some((view) => view.mesh);
  at("downloads-card").hidden = !isKept;
  if (isKept) {
    fillDownloads(at("downloads"), about.formats, result.id, state.row);
    at("downloads-row").textContent = result.frames ? "All hands of this file." : `As fitted with “${about.rows[number].title}”.`;
  }
}

function overlay() {
  const entries = state.views.map((view) => view.entry);
  // A played video has its hands drawn on it.
  const isShown = entries.length > 0 && !(state.result?.hasVideo && state.result.frames);
  at("overlay").toggleAttribute("hidden", !isShown);
  at("photo-options").hidden = !isShown;
  if (!isShown) return;
  const size = state.size ?? (state.result?.frames ? entries[0].camera?.image_size : null);
  drawOverlay(at("overlay"), entries, shownPlane(entries, size), {
    given: at("show-given").checked, fitted: at("show-fitted").checked, ellipses: at("show-ellipses").checked,
  });
}

// --- Webcam ----------------------------------------------------------------------------------------------

async function startWebcam() {
  tell("");
  player.pause();
  const number = state.work;
  at("webcam").disabled = true;
  try {
    await webcam.start();
  } catch (error) {
    tell(error.message);
    return;
  } finally {
    at("webcam").disabled = false;
  }
  // A file was given while the browser asked for permission.
  if (number !== state.work) {
    webcam.stop();
    return;
  }
  // A file that is still worked on is left, and goes on if there is no camera.
  state.work++;
  player.close();
  showVideo(false);
  Object.assign(state, { result: null, views: [], which: null, row: about.rows.at(-1).key });
  at("views").classList.remove("is-empty");
  at("empty").hidden = at("scene-empty").hidden = at("photo").hidden = at("working").hidden = true;
  at("ladder").hidden = at("facts").hidden = at("player").hidden = true;
  at("overlay").replaceChildren();
  at("video").hidden = at("keep").hidden = at("photo-options").hidden = at("scene-options").hidden = at("legend").hidden = false;
  at("show-ghost").closest("label").hidden = at("which-label").hidden = true;
  at("stage").classList.add("is-mirrored");
  at("webcam").textContent = "Stop the webcam";
  at("webcam").classList.add("is-on");
}

function showLive(found, rate) {
  // The image that these hands are of, which is older than what the camera sees by now.
  const live = at("live");
  Object.assign(live, { width: webcam.canvas.width, height: webcam.canvas.height });
  live.getContext("2d").drawImage(webcam.canvas, 0, 0);
  live.hidden = false;
  at("video").hidden = true;
  const isNew = !state.views.length && found.hands.length > 0;
  state.size = found.size;
  showViews(found.hands, { isNew, animate: false });
  at("facts").hidden = !found.hands.length;
  at("status").textContent = `${rate.toFixed(0)} images per second` + (found.hands.length ? "" : " · no hand yet");
}

function liveEnded(error) {
  at("webcam").textContent = "Use the webcam";
  at("webcam").classList.remove("is-on");
  // The last image stays with its hands.
  at("keep").hidden = at("video").hidden = true;
  if (error) tell(error);
  if (at("live").hidden && !state.result) at("empty").hidden = false;
  if (!state.result) at("status").textContent = "";
}

async function keepImage() {
  const blob = await webcam.image(1920, 0.92);
  openFile(new File([blob], "webcam.jpg", { type: "image/jpeg" }));
}

// --- Buttons ---------------------------------------------------------------------------------------------

function listen() {
  at("file").addEventListener("change", () => {
    if (at("file").files[0]) openFile(at("file").files[0]);
    at("file").value = "";
  });
  at("webcam").addEventListener("click", () => webcam.isOn ? webcam.stop() : startWebcam());
  at("keep").addEventListener("click", keepImage);
  for (const id of ["show-given", "show-fitted", "show-ellipses"]) at(id).addEventListener("change", overlay);
  at("which").addEventListener("change", () => {
    state.which = Number(at("which").value);
    showRow(true);
  });
  for (const id of ["show-ghost", "show-ellipsoids"]) at(id).addEventListener("change", () => showViews(state.views));
  at("reset-view").addEventListener("click", () => scene.fromCamera?.());
  listenForFiles(at("drop"), openFile, tell);
  new ResizeObserver(overlay).observe(at("views"));
}

function offerExamples() {
  if (!about.examples.length) return;
  at("examples").append(made("span", "or an example:"), ...about.examples.map((name, number) => {
    const button = made("button", name.replace(/\.\w+$/, "").replace("_", " "), "link");
    button.type = "button";
    button.addEventListener("click", () => {
      webcam.stop();
      work(() => asked(`api/example/${number}`, { method: "POST" }), `Working on ${name}…`);
    });
    return button;
  }));
}

async function begin() {
  listen();
  try {
    about = await asked("api/about");
  } catch (error) {
    tell(error.message);
    return;
  }
  try {
    scene = new HandScene(at("scene"), about.model);
  } catch {
    // Everything but the 3D view goes on.
    scene = { isMissing: true, show() {} };
    tell("This browser has no WebGL; expected it for the 3D hand. Switch its hardware acceleration on, and reload the page.");
  }
  at("version").textContent = `hand_recon ${about.version}.`;
  offerExamples();
  document.body.dataset.ready = "true";
  if (about.opened) {
    await work(async () => ({ ...await asked("api/opened", { method: "POST" }), hasVideo: about.has_video }), `Opening ${about.opened}…`);
  }
}

begin();

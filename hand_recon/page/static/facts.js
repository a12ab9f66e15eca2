// Words about the hands: knowledge rows with their changes, verdicts, the camera, downloads.

const CAMERAS = {
  assumed: "The camera is assumed, with a focal length of 1.2 times the image’s longer side: shapes and angles can be used, distances are rough.",
  landmarks: "The camera is assumed, with a focal length of 500 pixels for 224 pixels about the hand: shapes and angles can be used, distances are rough.",
  EXIF: "The focal length is the photograph’s own (EXIF): distances are as good as the hand’s true size, which one image does not show.",
  given: "The camera was given: distances are as good as the hand’s true size, which one image does not show.",
  "field of view": "The camera has the given field of view: distances are as good as that angle.",
};

export function made(kind, text = "", name = "") {
  const one = document.createElement(kind);
  one.textContent = text;
  if (name) one.className = name;
  return one;
}

// Radio buttons, one for each row; arrow keys go through them.
export function fillRows(place, rows, found, chosen, choose) {
  place.replaceChildren(...rows.map((row, number) => {
    const label = made("label", "", "row");
    const input = document.createElement("input");
    Object.assign(input, { type: "radio", name: "row", value: row.key, checked: row.key === chosen });
    input.addEventListener("change", () => choose(row.key));
    const box = made("div");
    const views = found[row.key];
    input.disabled = !views;
    box.append(made("span", number ? `+ ${number}` : "0", "step"), made("b", row.title), ...(views ? [change(views, number), limits(views)] : [made("span", "fitting…", "change")]));
    label.append(input, box);
    return label;
  }));
}

function change(views, number) {
  const changes = views.map((view) => view.change_from_before).filter(Boolean);
  if (!number || !changes.length) return made("span", number ? "…" : "where it begins", "change");
  const mean = (key) => changes.reduce((sum, one) => sum + one[key], 0) / changes.length;
  const text = made("span", `${mean("millimetres").toFixed(1)}\u00a0mm · ${mean("degrees").toFixed(0)}°`, "change");
  text.title = "Mean change from the row before: of the landmarks, with the wrists in one place, and of each joint’s angle";
  return text;
}

function limits(views) {
  const beyond = views.flatMap((view) => view.beyond ?? []);
  if (!beyond.length) return made("span", "inside all limits", "limits");
  const farthest = Math.max(...beyond.map((one) => Math.abs(one.degrees)));
  return made("span", `${beyond.length} beyond, up to ${farthest.toFixed(0)}°`, farthest >= 5 ? "limits is-bad" : "limits");
}

export function rowSentence(row, views, number) {
  const changes = views.map((view) => view.change_from_first).filter(Boolean);
  if (!number || !changes.length) return row.sentence;
  const largest = changes.reduce((a, b) => a.largest_degrees > b.largest_degrees ? a : b);
  return `${row.sentence} Against no knowledge, a landmark moved by up to ${Math.max(...changes.map((one) => one.largest_millimetres)).toFixed(0)}\u00a0mm, `
    + `and the ${largest.joint} by ${largest.largest_degrees.toFixed(0)}°.`;
}

export function fillHands(place, views) {
  if (!views.length) {
    place.replaceChildren(made("p", "No hand was found. Try a photograph in which a hand is larger, sharper, or less hidden."));
    return;
  }
  place.replaceChildren(...views.map((view, number) => {
    const { entry } = view;
    const box = made("div", "", "hand-facts");
    const title = made("h3", `${entry.side === "left" ? "Left" : "Right"} hand${views.length > 1 ? ` ${number + 1}` : ""}`);
    title.append(made("span", entry.verdict, `verdict ${entry.verdict.split(" ")[0]}`));
    box.append(title);
    for (const reason of entry.reasons) box.append(made("p", reason));
    if (view.mesh) box.append(made("p", inWords(view)));
    return box;
  }));
}

function inWords(view) {
  const { entry } = view;
  const fit = entry.residual === null ? "" : `Fitted to ${entry.residual.toFixed(1)} px. `;
  if (!view.beyond.length) return `${fit}Every angle is inside its range of motion.`;
  const some = view.beyond.slice(0, 4).map((one) => `${one.joint} ${one.axis} by ${Math.abs(one.degrees).toFixed(0)}°`);
  const more = view.beyond.length > some.length ? ` and ${view.beyond.length - some.length} more` : "";
  return `${fit}Beyond their limits: ${some.join(", ")}${more}.`;
}

export function cameraSentence(views, hasImage) {
  const source = views.find((view) => view.entry.camera)?.entry.camera.source;
  return CAMERAS[source === "assumed" && !hasImage ? "landmarks" : source] ?? "";
}

export function fillDownloads(place, formats, id, row) {
  place.replaceChildren(...formats.map((format) => {
    const item = made("li");
    const link = made("a");
    link.href = `api/download/${id}/${row}/${format.name}`;
    link.download = "";
    link.append(made("b", format.name), made("span", format.purpose));
    item.append(link);
    return item;
  }));
}

// Landmarks, the fitted hand's bones and σ, drawn over the photograph in its own pixels.

const PARENTS = [-1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19];
// Fingers' colours of Fig. 4: thumb black, index yellow, middle green, ring blue, little magenta.
const COLOURS = ["#1e1e1e", "#f0be14", "#28a046", "#3264dc", "#cd32a0"];
const SPACE = "http://www.w3.org/2000/svg";

const finger = (landmark) => COLOURS[Math.floor(Math.max(landmark - 1, 0) / 4)];

function element(kind, attributes) {
  const made = document.createElementNS(SPACE, kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

// The part of the plane that is shown: the photograph, or what the landmarks need where there is none.
export function shownPlane(entries, size) {
  if (size) return [0, 0, size[0], size[1]];
  const points = entries.flatMap((one) => [...(one.observed_2d ?? []), ...(one.landmarks_2d ?? [])]).filter(Boolean);
  if (!points.length) return [0, 0, 1, 1];
  const [us, vs] = [points.map((point) => point[0]), points.map((point) => point[1])];
  const [left, top] = [Math.min(...us), Math.min(...vs)];
  const [width, height] = [Math.max(...us) - left || 1, Math.max(...vs) - top || 1];
  const margin = 0.12 * Math.max(width, height);
  return [left - margin, top - margin, width + 2 * margin, height + 2 * margin];
}

export function drawOverlay(svg, entries, plane, show) {
  const [left, top, width, height] = plane;
  svg.setAttribute("viewBox", plane.join(" "));
  const box = svg.getBoundingClientRect();
  // Pixels of the photograph for one of the screen.
  const unit = Math.max(width / (box.width || width), height / (box.height || height));
  const parts = [];
  for (const entry of entries) {
    if (show.ellipses) parts.push(...ellipses(entry, unit));
    if (show.fitted) parts.push(...bones(entry, unit));
    if (show.given) parts.push(...given(entry, unit));
  }
  svg.replaceChildren(...parts);
}

function ellipses(entry, unit) {
  const centres = entry.observed_2d ?? entry.landmarks_2d;
  if (!entry.sigma_2d || !centres) return [];
  return entry.sigma_2d.flatMap((sigma, landmark) => {
    const centre = centres[landmark];
    if (!centre) return [];
    return [element("ellipse", {
      cx: centre[0], cy: centre[1], rx: 2 * sigma[0], ry: 2 * sigma[1], fill: finger(landmark), "fill-opacity": 0.16,
      stroke: finger(landmark), "stroke-opacity": 0.75, "stroke-width": unit,
    })];
  });
}

function bones(entry, unit) {
  const points = entry.landmarks_2d;
  if (!points) return [];
  const lines = (colour, width, opacity) => PARENTS.flatMap((parent, landmark) => parent < 0 ? [] : [element("line", {
    x1: points[parent][0], y1: points[parent][1], x2: points[landmark][0], y2: points[landmark][1],
    stroke: colour ?? finger(landmark), "stroke-width": width * unit, "stroke-opacity": opacity, "stroke-linecap": "round",
  })]);
  // A pale line below makes the bones visible on skin and on dark backgrounds alike.
  return [...lines("#ffffff", 5, 0.75), ...lines(null, 2.6, 1)];
}

function given(entry, unit) {
  return (entry.observed_2d ?? []).flatMap((point, landmark) => point ? [element("circle", {
    cx: point[0], cy: point[1], r: 3.6 * unit, fill: "#ffffff", stroke: finger(landmark), "stroke-width": 1.8 * unit,
  })] : []);
}

// Hands in 3D, to be rotated: coloured by how near each joint is to its limit, with ghosts and ellipsoids.

import * as THREE from "three";
import { OrbitControls } from "/static/vendor/three/OrbitControls.js";
import { unpacked } from "./requests.js";

const FREE = new THREE.Color("#d8c2ad");
const NEAR = new THREE.Color("#f0a030");
const BEYOND = new THREE.Color("#d3302a");
// Angle beyond a limit that has the full colour, degrees.
const FAR_BEYOND = 15;
const MOTION = 260;
// Room around the hands, as a factor of their extent.
const MARGIN = 1.12;

export class HandScene {
  constructor(place, model) {
    this.place = place;
    this.weights = unpacked(model.weights, Uint8Array);
    this.joints = model.joints;
    const faces = unpacked(model.faces, Uint16Array);
    this.faces = { right: faces, left: reversed(faces) };
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    place.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.01, 20);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.enablePan = false;
    this.controls.addEventListener("change", () => this.draw());
    this.camera.add(...lights());
    this.scene.add(this.camera, new THREE.HemisphereLight(0xffffff, 0x9a9088, 1.75));
    this.hands = [];
    this.extras = new THREE.Group();
    this.scene.add(this.extras);
    this.motion = 0;
    new ResizeObserver(() => this.resize()).observe(place);
    place.addEventListener("keydown", (event) => this.byKey(event));
    this.resize();
  }

  // Hands of one row or frame. They are moved so that the mean wrist is at the origin.
  show(views, { ghosts = [], ellipsoids = false, isNew = false, animate = true } = {}) {
    // The place may have changed its size with what the page shows.
    if (isNew) this.resize();
    const fitted = views.filter((view) => view.mesh);
    const origin = meanWrist(fitted);
    const wanted = fitted.map((view) => ({
      side: view.entry.side, points: moved(unpacked(view.mesh, Float32Array), origin), colours: this.colours(view),
    }));
    const same = !isNew && wanted.length === this.hands.length
      && wanted.every((one, place) => one.side === this.hands[place].side);
    if (!same) this.rebuild(wanted);
    this.extras.clear();
    ghosts.forEach((ghost, place) => this.addGhost(ghost, views[place], origin));
    if (ellipsoids) fitted.forEach((view) => this.addEllipsoids(view.entry, origin));
    if (isNew) this.lookFromCamera(origin);
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.moveTo(wanted, same && animate && !still ? MOTION : 0);
  }

  rebuild(wanted) {
    for (const hand of this.hands) {
      this.scene.remove(hand.mesh);
      hand.mesh.geometry.dispose();
    }
    this.hands = wanted.map((one) => {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(one.points.slice(), 3));
      geometry.setAttribute("color", new THREE.BufferAttribute(one.colours.slice(), 3));
      geometry.setIndex(new THREE.BufferAttribute(this.faces[one.side], 1));
      geometry.computeVertexNormals();
      const material = new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.72, side: THREE.DoubleSide });
      const mesh = new THREE.Mesh(geometry, material);
      mesh.frustumCulled = false;
      this.scene.add(mesh);
      return { side: one.side, mesh };
    });
  }

  moveTo(wanted, milliseconds) {
    const number = ++this.motion;
    const begun = performance.now();
    const from = this.hands.map((hand) => [
      hand.mesh.geometry.attributes.position.array.slice(), hand.mesh.geometry.attributes.color.array.slice(),
    ]);
    const step = (now) => {
      if (number !== this.motion) return;
      const passed = milliseconds ? Math.min(Math.max(now - begun, 0) / milliseconds, 1) : 1;
      const share = passed * passed * (3 - 2 * passed);
      this.hands.forEach((hand, place) => {
        const { position, color } = hand.mesh.geometry.attributes;
        blend(position.array, from[place][0], wanted[place].points, share);
        blend(color.array, from[place][1], wanted[place].colours, share);
        position.needsUpdate = color.needsUpdate = true;
        hand.mesh.geometry.computeVertexNormals();
      });
      this.draw();
      if (passed < 1) requestAnimationFrame(step);
    };
    step(begun);
  }

  // Each joint's colour is carried by its skinning weights.
  colours(view) {
    const values = [0, ...view.closeness];
    for (const { joint, degrees } of view.beyond) {
      const place = this.joints.indexOf(joint) + 1;
      values[place] = Math.max(values[place], 1 + Math.min(Math.abs(degrees) / FAR_BEYOND, 1));
    }
    const vertices = this.weights.length / values.length;
    const colours = new Float32Array(3 * vertices);
    const colour = new THREE.Color();
    for (let vertex = 0; vertex < vertices; vertex++) {
      let value = 0;
      values.forEach((one, joint) => { value += one * this.weights[vertex * values.length + joint] / 255; });
      if (value <= 1) colour.lerpColors(FREE, NEAR, value);
      else colour.lerpColors(NEAR, BEYOND, Math.min(value - 1, 1));
      colour.toArray(colours, 3 * vertex);
    }
    return colours;
  }

  addGhost(ghost, view, origin) {
    if (!ghost?.mesh || !view?.mesh) return;
    // Both wrists are in one place, since the depth of a whole hand is not what differs.
    const [own, other] = [view.entry.landmarks_3d[0], ghost.entry.landmarks_3d[0]];
    const shift = origin.map((value, axis) => value + other[axis] - own[axis]);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(moved(unpacked(ghost.mesh, Float32Array), shift), 3));
    geometry.setIndex(new THREE.BufferAttribute(this.faces[ghost.entry.side], 1));
    geometry.computeVertexNormals();
    const material = new THREE.MeshStandardMaterial({
      color: 0x5b7fb5, transparent: true, opacity: 0.24, depthWrite: false, roughness: 1, side: THREE.DoubleSide,
    });
    this.extras.add(new THREE.Mesh(geometry, material));
  }

  addEllipsoids(entry, origin) {
    if (!entry.covariance_3d) return;
    const sphere = new THREE.SphereGeometry(1, 20, 14);
    const material = new THREE.MeshStandardMaterial({ color: 0x2f7f78, transparent: true, opacity: 0.42, depthWrite: false });
    entry.covariance_3d.forEach((covariance, landmark) => {
      const factor = cholesky(covariance);
      const centre = entry.landmarks_3d[landmark].map((value, axis) => value - origin[axis]);
      const mesh = new THREE.Mesh(sphere, material);
      mesh.matrixAutoUpdate = false;
      const row = (axis, sign) => [...factor[axis].map((value) => 2 * sign * value), sign * centre[axis]];
      mesh.matrix.set(...row(0, 1), ...row(1, -1), ...row(2, -1), 0, 0, 0, 1);
      this.extras.add(mesh);
    });
  }

  // Where the photograph was taken from, as near as the hands need.
  lookFromCamera(origin) {
    this.fromCamera = () => {
      const box = new THREE.Box3();
      for (const { mesh } of this.hands) {
        mesh.geometry.computeBoundingBox();
        box.union(mesh.geometry.boundingBox);
      }
      const centre = box.isEmpty() ? new THREE.Vector3() : box.getCenter(new THREE.Vector3());
      // The camera was at −origin, in three's axes.
      const direction = new THREE.Vector3(-origin[0], origin[1], origin[2]).sub(centre).normalize();
      this.controls.target.copy(centre);
      this.camera.position.copy(centre).add(direction);
      this.camera.lookAt(centre);
      this.camera.position.copy(centre).addScaledVector(direction, this.distanceFor(centre));
      this.controls.update();
      this.draw();
    };
    this.fromCamera();
  }

  // Smallest distance at which all of the hands are in view, for the camera's present direction.
  distanceFor(centre) {
    const high = Math.tan(THREE.MathUtils.degToRad(this.camera.fov / 2)) / MARGIN;
    const wide = high * this.camera.aspect;
    const axes = new THREE.Matrix3().setFromMatrix4(new THREE.Matrix4().makeRotationFromQuaternion(
      this.camera.quaternion.clone().invert(),
    ));
    const point = new THREE.Vector3();
    let distance = 0.05;
    for (const { mesh } of this.hands) {
      const { position } = mesh.geometry.attributes;
      for (let vertex = 0; vertex < position.count; vertex++) {
        point.fromBufferAttribute(position, vertex).sub(centre).applyMatrix3(axes);
        distance = Math.max(distance, point.z + Math.abs(point.x) / wide, point.z + Math.abs(point.y) / high);
      }
    }
    return distance;
  }

  byKey(event) {
    const turns = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, -0.15], ArrowDown: [0, 0.15] };
    if (!(event.key in turns)) return;
    event.preventDefault();
    const [around, over] = turns[event.key];
    const place = new THREE.Spherical().setFromVector3(this.camera.position.clone().sub(this.controls.target));
    place.theta += around;
    place.phi = Math.min(Math.max(place.phi + over, 0.05), Math.PI - 0.05);
    this.camera.position.setFromSpherical(place).add(this.controls.target);
    this.controls.update();
    this.draw();
  }

  resize() {
    const { clientWidth, clientHeight } = this.place;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    this.renderer.render(this.scene, this.camera);
  }
}

function lights() {
  const key = new THREE.DirectionalLight(0xffffff, 1.9);
  key.position.set(-0.45, 0.7, 0.6);
  const target = new THREE.Object3D();
  target.position.set(0, 0, -1);
  key.target = target;
  return [key, target];
}

function reversed(faces) {
  const other = faces.slice();
  for (let place = 0; place < other.length; place += 3) [other[place], other[place + 1]] = [faces[place + 1], faces[place]];
  return other;
}

function meanWrist(views) {
  const wrists = views.map((view) => view.entry.landmarks_3d[0]);
  return [0, 1, 2].map((axis) => wrists.reduce((sum, one) => sum + one[axis], 0) / (wrists.length || 1));
}

// From the camera's axes (x right, y down, z forward) to three's (x right, y up, z to the viewer).
function moved(points, origin) {
  const result = new Float32Array(points.length);
  for (let place = 0; place < points.length; place += 3) {
    result[place] = points[place] - origin[0];
    result[place + 1] = origin[1] - points[place + 1];
    result[place + 2] = origin[2] - points[place + 2];
  }
  return result;
}

function blend(target, from, to, share) {
  for (let place = 0; place < target.length; place++) target[place] = from[place] + share * (to[place] - from[place]);
}

// L with L Lᵀ = covariance: it maps the unit sphere to the 1σ ellipsoid.
function cholesky(matrix) {
  const factor = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  for (let row = 0; row < 3; row++) {
    for (let column = 0; column <= row; column++) {
      let sum = matrix[row][column];
      for (let inner = 0; inner < column; inner++) sum -= factor[row][inner] * factor[column][inner];
      factor[row][column] = row === column ? Math.sqrt(Math.max(sum, 0)) : sum / (factor[column][column] || Infinity);
    }
  }
  return factor;
}

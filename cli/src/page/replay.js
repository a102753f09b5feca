// Plays films of robots: one view an engine, all with the same clock and the same camera.
// Lengths are metres, angles of view degrees. Poses come as 14 bytes a body and step: a place in 16-bit parts of its
// range, a quaternion in parts of 32767.

const BYTES = 14;
const CELL = 0.5;
const STRONG = 10;
const HALF_FLOOR = 20;
const FIELD = 38;

/** Makes modules of the scripts that the page carries as text. Nothing is fetched. */
function library() {
  library.loading ??= (async () => {
    const url = (text) => URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
    const three = url(document.getElementById("three-js").textContent);
    const orbit = document.getElementById("orbit-controls-js").textContent.replace("from 'three'", `from '${three}'`);
    const [THREE, { OrbitControls }] = await Promise.all([import(three), import(url(orbit))]);
    return { THREE, OrbitControls };
  })();
  return library.loading;
}

/** A film's poses, unpacked when it is first asked for. */
class Film {
  constructor(film, bodies) {
    Object.assign(this, film);
    this.bodies = bodies;
  }

  get view() {
    if (!this.unpacked) {
      const text = atob(this.poses);
      const bytes = new Uint8Array(text.length);
      for (let i = 0; i < text.length; i += 1) bytes[i] = text.charCodeAt(i);
      this.unpacked = new DataView(bytes.buffer);
    }
    return this.unpacked;
  }

  /** Puts the pose of `body` after `step` into a position and a quaternion. */
  read(step, body, position, quaternion) {
    const at = (step * this.bodies + body) * BYTES;
    const place = (axis) => this.low[axis] + (this.view.getUint16(at + 2 * axis, true) / 65535) * this.span[axis];
    const part = (i) => this.view.getInt16(at + 6 + 2 * i, true) / 32767;
    position.set(place(0), place(1), place(2));
    quaternion.set(part(1), part(2), part(3), part(0)).normalize();
  }
}

/** One engine's robot and floor. */
class View {
  constructor(THREE, engine) {
    this.THREE = THREE;
    this.engine = engine;
    this.films = engine.films.map((film) => new Film(film, engine.scene.bodies.length));
    this.scene = new THREE.Scene();
    this.painted = [];
    this.bodies = engine.scene.bodies.map(() => this.scene.add(new THREE.Group()).children.at(-1));
    engine.scene.solids.forEach((solid) => this.bodies[solid.body].add(this.solid(solid)));
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0xb0b0b0, 2.4));
    this.sun = new THREE.DirectionalLight(0xffffff, 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    Object.assign(this.sun.shadow.camera, { left: -4, right: 4, top: 4, bottom: -4, near: 0.1, far: 20 });
    this.scene.add(this.sun, this.sun.target);
    this.middle = new THREE.Vector3();
    this.next = { position: new THREE.Vector3(), quaternion: new THREE.Quaternion() };
    this.film = null;
  }

  solid({ body, pose, shape }) {
    const { THREE } = this;
    const [kind, size] = Object.entries(shape)[0];
    const geometry = {
      sphere: () => new THREE.SphereGeometry(size.radius, 32, 20),
      // Capsules of three.js lie along y, those of films along z.
      capsule: () => new THREE.CapsuleGeometry(size.radius, 2 * size.half_length, 12, 24).rotateX(Math.PI / 2),
      box: () => new THREE.BoxGeometry(...size.half_size.map((half) => 2 * half)),
    }[kind]();
    const material = new THREE.MeshStandardMaterial({ roughness: 0.55 });
    this.painted.push({ material, body });
    const mesh = new THREE.Mesh(geometry, material);
    mesh.castShadow = true;
    mesh.receiveShadow = true;
    mesh.position.set(...pose.position);
    const [w, x, y, z] = pose.rotation;
    mesh.quaternion.set(x, y, z, w);
    return mesh;
  }

  /** Takes up the page's colours. */
  repaint(colour) {
    const { THREE } = this;
    const shades = ["--c6", "--c5", "--c3", "--c4"].map(colour);
    for (const { material, body } of this.painted) material.color.set(body === 0 ? colour("--c2") : shades[body % shades.length]);
    const paper = new THREE.Color(colour("--panel"));
    this.scene.background = paper;
    this.scene.fog = new THREE.Fog(paper, 7, 18);
    if (!this.engine.scene.floor) return;
    if (this.floor) this.scene.remove(this.floor);
    this.floor = new THREE.Group();
    const plane = new THREE.PlaneGeometry(2 * HALF_FLOOR, 2 * HALF_FLOOR);
    const tiles = new THREE.Mesh(plane, new THREE.MeshBasicMaterial({ map: this.tiles(colour) }));
    tiles.position.z = -0.002;
    const shadow = new THREE.Mesh(plane, new THREE.ShadowMaterial({ opacity: 0.3 }));
    shadow.receiveShadow = true;
    this.floor.add(tiles, shadow);
    this.scene.add(this.floor);
  }

  /** A picture of `STRONG` by `STRONG` cells, which the floor repeats. */
  tiles(colour) {
    const { THREE } = this;
    const size = 1024;
    const picture = Object.assign(document.createElement("canvas"), { width: size, height: size });
    const brush = picture.getContext("2d");
    brush.fillStyle = colour("--panel");
    brush.fillRect(0, 0, size, size);
    const lines = (count, width, name) => {
      brush.fillStyle = colour(name);
      for (let i = 0; i <= count; i += 1) {
        const at = (i * size) / count - width / 2;
        brush.fillRect(at, 0, width, size);
        brush.fillRect(0, at, size, width);
      }
    };
    lines(STRONG, 4, "--line");
    lines(1, 10, "--soft");
    const texture = new THREE.CanvasTexture(picture);
    texture.colorSpace = THREE.SRGBColorSpace;
    texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
    texture.repeat.setScalar((2 * HALF_FLOOR) / (CELL * STRONG));
    texture.anisotropy = 8;
    return texture;
  }

  choose(who, context) {
    this.film = this.films.find((film) => film.who === who && film.context === context) ?? null;
    for (const body of this.bodies) body.visible = this.film !== null;
    if (this.film) {
      this.pose(0);
      this.start = this.middle.x;
      this.home = this.middle.clone();
    }
  }

  get last() {
    return this.film ? this.film.steps - 1 : 0;
  }

  /** Moves every body to where it is at `time`, in control steps, between two of them if need be. */
  pose(time) {
    if (!this.film) return;
    const whole = Math.min(Math.floor(time), this.last);
    const share = Math.min(time, this.last) - whole;
    this.bodies.forEach((body, index) => {
      this.film.read(whole, index, body.position, body.quaternion);
      if (share > 0) {
        this.film.read(whole + 1, index, this.next.position, this.next.quaternion);
        body.position.lerp(this.next.position, share);
        body.quaternion.slerp(this.next.quaternion, share);
      }
    });
    this.middle.copy(this.bodies[0].position);
  }

  /** The floor's lines stay where they are in the world, however far the robot walks. */
  follow(target) {
    if (this.floor) {
      const cell = CELL * STRONG;
      this.floor.position.set(Math.round(target.x / cell) * cell, Math.round(target.y / cell) * cell, 0);
    }
    this.sun.position.set(target.x - 2, target.y - 3, 7);
    this.sun.target.position.set(target.x, target.y, 0);
  }

  // As `format.rs` writes returns.
  earned() {
    const size = Math.abs(this.film.returns);
    return this.film.returns.toFixed(size === 0 || size >= 1 ? 1 : size >= 0.1 ? 2 : 3);
  }

  caption() {
    const name = `${this.engine.engine.name} ${this.engine.engine.version}`;
    if (!this.film) return [name, "no film of this option in this context"];
    return [name, `return ${this.earned()}, ${(this.middle.x - this.start).toFixed(2)} m forward`];
  }
}

/** The controls, the clock and the camera of one run's replay. */
class Player {
  constructor(root, { THREE, OrbitControls }) {
    this.root = root;
    this.THREE = THREE;
    const find = (name) => root.querySelector(name);
    this.part = Object.fromEntries(
      ["who", "context", "speed", "follow", "stage", "captions", "toggle", "time", "clock"].map((name) => [name, find(`.${name}`)]),
    );
    this.canvas = find("canvas");
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.setScissorTest(true);
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.engines = JSON.parse(find(".films").textContent);
    this.views = this.engines.map((engine) => new View(THREE, engine));
    this.step = this.engines[0].control_step;
    // The orbit is around the origin; each view puts its own robot there.
    this.orbit = new THREE.PerspectiveCamera(FIELD, 1, 0.05, 60);
    this.orbit.up.set(0, 0, 1);
    this.camera = this.orbit.clone();
    this.controls = new OrbitControls(this.orbit, this.canvas);
    Object.assign(this.controls, { enablePan: false, minDistance: 0.8, maxDistance: 14, maxPolarAngle: 1.53 });
    this.controls.addEventListener("change", () => this.draw());
    this.time = 0;
    this.playing = false;
    this.listen();
    this.fill();
    this.resetCamera();
    this.repaint();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.repaint());
  }

  listen() {
    const { who, context, follow, toggle, time, stage } = this.part;
    who.addEventListener("change", () => this.chooseWho(who.value));
    context.addEventListener("change", () => this.chooseFilm());
    follow.addEventListener("change", () => this.draw());
    toggle.addEventListener("click", () => this.play(!this.playing));
    time.addEventListener("input", () => this.seek(Number(time.value)));
    stage.addEventListener("keydown", (event) => this.key(event));
    for (const button of this.root.querySelectorAll(".camera button")) {
      button.addEventListener("click", () => this.moveCamera(button.dataset));
    }
  }

  fill() {
    const films = this.engines.flatMap((engine) => engine.films);
    const names = [...new Set(films.map((film) => film.who))];
    this.part.who.replaceChildren(...names.map((name) => new Option(name, name)));
    this.chooseWho(names[0]);
  }

  chooseWho(name) {
    this.part.who.value = name;
    const films = this.engines.flatMap((engine) => engine.films).filter((film) => film.who === name);
    const contexts = [...new Set(films.map((film) => film.context))].sort((a, b) => a - b);
    const before = Number(this.part.context.value);
    this.part.context.replaceChildren(...contexts.map((context) => new Option(context, context)));
    if (contexts.includes(before)) this.part.context.value = before;
    this.chooseFilm();
  }

  chooseFilm() {
    for (const view of this.views) view.choose(this.part.who.value, Number(this.part.context.value));
    this.part.time.max = this.last;
    this.seek(0);
  }

  get last() {
    return Math.max(1, ...this.views.map((view) => view.last));
  }

  play(playing) {
    if (playing && this.time >= this.last) this.time = 0;
    this.playing = playing;
    this.part.toggle.textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    let before = performance.now();
    const tick = (now) => {
      if (!this.playing) return;
      this.time += ((Math.max(0, now - before) / 1000) * Number(this.part.speed.value)) / this.step;
      before = now;
      if (this.time >= this.last) {
        this.time = this.last;
        this.play(false);
      }
      this.draw();
      if (this.playing) requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.last);
    this.draw();
  }

  key(event) {
    if (event.target !== this.part.stage) return;
    const steps = event.shiftKey ? 10 : 1;
    const act = {
      " ": () => this.play(!this.playing),
      ArrowLeft: () => this.seek(Math.ceil(this.time) - steps),
      ArrowRight: () => this.seek(Math.floor(this.time) + steps),
      Home: () => this.seek(0),
      End: () => this.seek(this.last),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  resetCamera() {
    this.orbit.position.set(0.6, -3.6, 1.1);
    this.controls.update();
  }

  moveCamera({ turn, zoom }) {
    const { Vector3 } = this.THREE;
    if (turn) this.orbit.position.applyAxisAngle(new Vector3(0, 0, 1), Number(turn) * 0.35);
    else if (zoom) this.orbit.position.multiplyScalar(Number(zoom));
    else this.resetCamera();
    this.controls.update();
    this.draw();
  }

  repaint() {
    const style = getComputedStyle(document.documentElement);
    for (const view of this.views) view.repaint((name) => style.getPropertyValue(name).trim());
    this.draw();
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0) return;
    const size = this.renderer.getSize(new this.THREE.Vector2());
    if (size.x !== width || size.y !== height) {
      this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
      this.renderer.setSize(width, height, false);
    }
    const part = width / this.views.length;
    this.views.forEach((view, index) => {
      view.pose(this.time);
      const target = (this.part.follow.checked || !view.home ? view.middle : view.home).clone();
      target.z = 0.45;
      view.follow(target);
      this.camera.copy(this.orbit);
      this.camera.aspect = part / height;
      // A view that is higher than wide shows as much from side to side as a square one.
      const half = Math.tan((FIELD / 2) * (Math.PI / 180)) / Math.min(1, this.camera.aspect);
      this.camera.fov = 2 * Math.atan(half) * (180 / Math.PI);
      this.camera.position.add(target);
      this.camera.updateProjectionMatrix();
      this.renderer.setViewport(index * part, 0, part, height);
      this.renderer.setScissor(index * part, 0, part, height);
      this.renderer.render(view.scene, this.camera);
    });
    this.tell();
  }

  tell() {
    const { captions, time, clock } = this.part;
    const texts = this.views.map((view) => view.caption());
    while (captions.children.length < texts.length) {
      captions.append(document.createElement("p"));
      captions.lastChild.append(document.createElement("strong"), document.createElement("span"));
    }
    texts.forEach((lines, index) => lines.forEach((line, place) => {
      captions.children[index].children[place].textContent = line;
    }));
    time.value = Math.round(this.time);
    const seconds = (steps) => (steps * this.step).toFixed(2);
    clock.textContent = `${seconds(this.time)} of ${seconds(this.last)} s`;
    time.setAttribute("aria-valuetext", clock.textContent);
  }
}

/** The player of a replay, made when it is first needed. */
function player(root) {
  root.player ??= library()
    .then((found) => new Player(root, found))
    .catch((error) => {
      const note = root.querySelector(".error");
      note.hidden = false;
      note.textContent = `The replay cannot be shown here: ${error.message}`;
      return null;
    });
  return root.player;
}

const near = new IntersectionObserver(
  (entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      near.unobserve(entry.target);
      player(entry.target);
    }
  },
  { rootMargin: "400px" },
);
for (const root of document.querySelectorAll(".replay")) near.observe(root);

for (const button of document.querySelectorAll("button[data-play]")) {
  button.addEventListener("click", async () => {
    const root = document.querySelector(`#${button.dataset.replay} .replay`);
    root.scrollIntoView({ block: "center" });
    const found = await player(root);
    if (!found) return;
    found.chooseWho(button.dataset.play);
    found.play(true);
    found.part.stage.focus({ preventScroll: true });
  });
}

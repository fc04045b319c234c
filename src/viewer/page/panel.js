// SPDX-License-Identifier: BSD-3-Clause
// Buttons, sliders and figures around the image.

const byId = (id) => document.getElementById(id);
const touch = matchMedia("(pointer: coarse)").matches;
const HINTS = touch ? {
  orbit: "Drag to turn, two fingers to move and zoom, tap twice to turn about a point.",
  fly: "Drag to look, two fingers to move.",
  follow: "The vehicle's camera. Drag to look around, pinch to step back.",
} : {
  orbit: "Drag to turn, Shift-drag to move, scroll to zoom, double-click to turn about a point.",
  fly: "W A S D to move, Q E down and up, Shift faster. Drag to look.",
  follow: "The vehicle's camera. Drag to look around, scroll to step back, Space to play.",
};

// A group of buttons of which one is chosen.
class Choice {
  constructor(group, chosen) {
    this.buttons = [...group.children];
    for (const button of this.buttons) button.addEventListener("click", () => chosen(button.dataset.value));
  }

  set(value) {
    for (const button of this.buttons) {
      button.setAttribute("aria-checked", String(button.dataset.value === value));
    }
  }

  enable(value, enabled) {
    this.buttons.find((b) => b.dataset.value === value).hidden = !enabled;
  }
}

const clockText = (s) => {
  const t = Math.round(s);
  return `${Math.floor(t / 60)}:${String(t % 60).padStart(2, "0")}`;
};
const countText = (n) => (n >= 1e6 ? `${(n / 1e6).toFixed(2)} M` : n >= 1e4 ? `${Math.round(n / 1e3)} k` : String(n));

function showLegend(states) {
  byId("legend").replaceChildren(...[...new Set(states)].map((state) => {
    const [text, color] = stateStyle(state);
    const item = document.createElement("li");
    const mark = document.createElement("i");
    mark.style.background = color;
    item.append(mark, text);
    return item;
  }));
}

function showRates(figures) {
  byId("rates").replaceChildren(...figures.flatMap(([name, value]) => {
    const term = document.createElement("dt");
    const figure = document.createElement("dd");
    term.textContent = name;
    figure.textContent = value;
    return [term, figure];
  }));
}

function notice(text) {
  byId("notice").hidden = !text;
  byId("notice").textContent = text || "";
}

function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// Rows of the matrix that maps the world to a camera with this pose.
function worldToCamera(pose) {
  const q = conjugate(rotationOf(pose));
  const columns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => rotate(q, axis));
  const t = times(rotate(q, placeOf(pose)), -1);
  return [0, 1, 2].map((r) => [...columns.map((c) => c[r]), t[r]]).concat([[0, 0, 0, 1]]);
}

// The camera.json of `apvi render --camera`, in the coordinates of the recording.
function cameraFile(view, origin) {
  const focal = view.focal * view.height;
  return JSON.stringify({
    width: view.width, height: view.height, pixel_center: 0.5,
    K: [[focal, 0, view.width / 2], [0, focal, view.height / 2], [0, 0, 1]],
    T_cam_world: worldToCamera(poseOf(rotationOf(view.pose), add(placeOf(view.pose), origin))),
  }, null, 1);
}

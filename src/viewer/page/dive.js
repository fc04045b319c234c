// SPDX-License-Identifier: BSD-3-Clause
// What a dive has besides map and path: loop closures, beams of the DVL, and which sensor served when.

const PING_S = 1; // how old the ping that is shown may be, at least
const POSE_GAP_S = 2; // from the path to a stamp beside it
const SENSORS = { camera: "Camera", imu: "IMU", dvl: "DVL", pressure: "Pressure", depth: "Depth" };
const LIVE_LAG_S = 2.5; // of what a run sends of its sensors
const SENSOR_ROW_PX = 12; // as in viewer.css

// Index of the last of the increasing stamps that is not later, or 0.
function indexAt(stamps, stamp) {
  let [low, high] = [0, stamps.length];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (stamps[middle] <= stamp) low = middle;
    else high = middle;
  }
  return low;
}

// Pose of the body at a stamp, interpolated; null without a path there.
function bodyAt({ stamps, poses }, stamp) {
  const last = stamps.length - 1;
  if (last < 0 || stamp < stamps[0] - POSE_GAP_S || stamp > stamps[last] + POSE_GAP_S) return null;
  const i = Math.min(indexAt(stamps, stamp), Math.max(0, last - 1));
  const j = Math.min(i + 1, last);
  return between(poses[i], poses[j], clamp((stamp - stamps[i]) / Math.max(1e-9, stamps[j] - stamps[i]), 0, 1));
}

// Time of the slider, 0 to 1, as a stamp.
const stampAt = ({ stamps }, time) => (stamps.length > 0 ? stamps[0] + time * (stamps[stamps.length - 1] - stamps[0]) : 0);

// Ends of the loop closures in the world.
function loopLines(scene) {
  return scene.loops.map((loop) => loop.map((stamp) => bodyAt(scene, stamp)))
    .filter(([from, to]) => from && to).map((ends) => ends.map(placeOf));
}

// The beams of the newest ping at a time: [{from, to, valid, measured}, ...].
function beamLines(scene, time) {
  const { beams } = scene;
  const stamp = stampAt(scene, time);
  const body = bodyAt(scene, stamp);
  if (!beams || beams.stamps.length === 0 || !body) return [];
  const i = indexAt(beams.stamps, stamp);
  // The server leaves out pings of a very long dive.
  const count = beams.stamps.length;
  const limit = Math.max(PING_S, 1.5 * (beams.stamps[count - 1] - beams.stamps[0]) / count);
  if (Math.abs(beams.stamps[i] - stamp) > limit) return [];
  const dvl = compose(body, beams.mount);
  return beams.directions.map((direction, k) => ({
    from: placeOf(dvl), to: add(placeOf(dvl), rotate(rotationOf(dvl), times(direction, beams.lengths[i][k]))),
    valid: (beams.valid[i] >> k & 1) === 1, measured: (beams.measured[i] >> k & 1) === 1,
  }));
}

function addPings(scene, message) {
  const { beams } = scene;
  if (!beams) return;
  const last = beams.stamps.length > 0 ? beams.stamps[beams.stamps.length - 1] : -Infinity;
  const from = message.stamps.findIndex((stamp) => stamp > last); // the scene may have the first ones
  if (from < 0) return;
  for (const name of ["stamps", "lengths", "valid", "measured"]) beams[name].push(...message[name].slice(from));
}

// The strip of states under the time slider.
function drawStates(scene) {
  const canvas = byId("states");
  canvas.width = Math.max(1, canvas.clientWidth * devicePixelRatio);
  canvas.height = 5 * devicePixelRatio;
  const context = canvas.getContext("2d");
  const place = placeInTime(scene, canvas.width);
  for (let i = 1; i < scene.stamps.length; ++i) {
    context.fillStyle = stateStyle(scene.states[i])[1];
    const from = place(scene.stamps[i - 1]);
    context.fillRect(from, 0, Math.max(1, place(scene.stamps[i]) - from + 0.5), canvas.height);
  }
}

function placeInTime({ stamps }, width) {
  const [first, last] = [stamps[0], stamps[stamps.length - 1]];
  return (stamp) => width * clamp((stamp - first) / Math.max(1e-9, last - first), 0, 1);
}

// While a run is made, the spans come later than the poses; that is no gap.
function spansUntilNow(scene, spans) {
  const last = scene.stamps[scene.stamps.length - 1];
  const isLate = (to, i) => scene.live && i === spans.length - 1 && last - to < LIVE_LAG_S;
  return spans.map(([from, to], i) => [from, isLate(to, i) ? Math.max(last, to) : to]);
}

// How long a sensor was silent during the path, in words.
function gapsText(scene, sensor) {
  const { name } = sensor;
  const spans = spansUntilNow(scene, sensor.spans);
  const [first, last] = [scene.stamps[0], scene.stamps[scene.stamps.length - 1]];
  let [end, silent, count] = [first, 0, 0];
  for (const [from, to] of [...spans, [last, last]]) {
    const gap = Math.min(from, last) - end;
    if (gap > 0.2) [silent, count] = [silent + gap, count + 1];
    end = Math.max(end, to);
  }
  const what = count === 0 ? "no gap" : `silent for ${silent.toFixed(1)} s, ${count} gap${count > 1 ? "s" : ""}`;
  return `${SENSORS[name] || name}: ${what}`;
}

// A row for each sensor, filled while it serves.
function drawSensors(scene) {
  const { sensors } = scene;
  const canvas = byId("sensors");
  const shown = sensors.length > 0 && scene.stamps.length > 1;
  byId("sensor-names").hidden = byId("sensor-rows").hidden = !shown;
  if (!shown) return;
  byId("sensor-names").replaceChildren(...sensors.map((sensor) => {
    const item = document.createElement("li");
    item.textContent = SENSORS[sensor.name] || sensor.name;
    item.title = gapsText(scene, sensor);
    return item;
  }));
  canvas.setAttribute("aria-label", sensors.map((sensor) => gapsText(scene, sensor)).join("; "));
  canvas.style.height = `${SENSOR_ROW_PX * sensors.length}px`;
  canvas.width = Math.max(1, canvas.clientWidth * devicePixelRatio);
  canvas.height = SENSOR_ROW_PX * sensors.length * devicePixelRatio;
  const context = canvas.getContext("2d");
  const place = placeInTime(scene, canvas.width);
  sensors.forEach(({ spans }, row) => {
    const [top, height] = [(row * SENSOR_ROW_PX + 3) * devicePixelRatio, (SENSOR_ROW_PX - 6) * devicePixelRatio];
    context.fillStyle = "rgba(240, 96, 107, .75)";
    context.fillRect(0, top, canvas.width, height);
    for (const [from, to] of spansUntilNow(scene, spans)) {
      const [left, right] = [place(from), place(to)];
      context.clearRect(left, top, right - left, height);
      context.fillStyle = "#7f93a3";
      context.fillRect(left, top, right - left, height);
    }
  });
}

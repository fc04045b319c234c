// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/merge_sessions.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "apvi/geometry/so3.hpp"
#include "loop_closure/known_map.hpp"
#include "loop_closure/map_anchors.hpp"
#include "loop_closure/relocalizer.hpp"

namespace apvi::loop_closure {
namespace {

constexpr std::size_t kTries = 4;             // hypotheses that are followed, of two sessions
constexpr std::size_t kMinEdges = 6;          // of a session that is found
constexpr std::size_t kEdgesPerRejected = 4;  // at least so many
constexpr double kNews = 1.0;                 // squared distance of an edge that changes the graph

struct EdgeCount {
  std::size_t accepted = 0;
  std::size_t rejected = 0;

  bool is_enough() const {
    return accepted >= kMinEdges && accepted >= kEdgesPerRejected * rejected;
  }
};

/// A placed session, as another one is searched in it.
struct Searched {
  std::size_t session = 0;
  KnownMap map;
};

class Merger {
 public:
  Merger(const std::vector<Session>& sessions, const SessionGraph::Options& options)
      : sessions_(sessions),
        gate_(options.gate),
        graph_(sessions, options),
        counts_(sessions.size()) {
    if (!sessions.empty()) graph_.place(0, {});
  }

  std::vector<MergedSession> run();

 private:
  bool find(std::size_t session);
  bool find_in(const Searched& searched, const std::vector<Searched>& placed, std::size_t session);
  bool follow(const Relocalization& found, const Searched& searched,
              const std::vector<Searched>& placed, std::size_t session);
  void place(const Relocalization& found, std::size_t earlier, std::size_t session);
  void extend(const Searched& searched, std::size_t session, std::size_t index);
  const MapPlace& place_of(std::size_t session, std::size_t place) const {
    return sessions_[session].places.places[place];
  }
  CrossEdge edge_of(const Anchor& anchor, std::size_t earlier, std::size_t session) const;
  SE3 predicted_map(std::size_t earlier, std::size_t session, const MapPlace& place) const;
  MergedSession result(std::size_t session) const;

  const std::vector<Session>& sessions_;
  double gate_;
  SessionGraph graph_;
  std::vector<EdgeCount> counts_;  ///< by session
};

/// Between the node of the earlier session nearest to the camera and that of the place.
CrossEdge Merger::edge_of(const Anchor& anchor, std::size_t earlier, std::size_t session) const {
  const MapPlace& place = place_of(session, anchor.keyframe);
  const SessionPath& known = graph_.path(earlier);
  const SessionPath& own = graph_.path(session);
  const std::size_t from = known.node_near(anchor.T_known_camera.translation);
  const std::size_t to = own.node_at(place.stamp);
  return {earlier,
          session,
          {.from = from,
           .to = to,
           .T_from_to = known.pose(from).inverse() * anchor.T_known_camera *
                        place.T_map_camera.inverse() * own.pose(to),
           .sigmas = anchor.sigmas,
           .is_loop = true}};
}

void Merger::place(const Relocalization& found, std::size_t earlier, std::size_t session) {
  const SE3 T_earlier_session = found.pose.T_world_map.inverse();
  const SE3& camera = place_of(session, found.images.back().keyframe).T_map_camera;
  const SessionPath& known = graph_.path(earlier);
  const std::size_t node = known.node_near(T_earlier_session * camera.translation);
  const SE3 T = known.corrections()[node].transform() * T_earlier_session;
  graph_.place(session, {.heading = so3::yaw(T.rotation), .translation = T.translation});
}

/// Where the map of an earlier session lies in the frame of another one, seen from a place.
SE3 Merger::predicted_map(std::size_t earlier, std::size_t session, const MapPlace& place) const {
  const SessionPath& known = graph_.path(earlier);
  const SE3 T_session_joint = graph_.path(session).correction(place.stamp).transform().inverse();
  const auto in_session = [&](std::size_t node) {
    return T_session_joint * known.corrections()[node].transform();
  };
  // The correction varies along the earlier session: first guess where the camera is there.
  const SE3 rough = in_session(0).inverse() * place.T_map_camera;
  const std::size_t near = known.node_near(rough.translation);
  const SE3 better = in_session(near).inverse() * place.T_map_camera;
  return in_session(known.node_near(better.translation));
}

void Merger::extend(const Searched& searched, std::size_t session, std::size_t index) {
  const MapPlace& place = place_of(session, index);
  const auto fix = searched.map.find_near(to_place(place), place.T_map_camera,
                                          predicted_map(searched.session, session, place));
  if (!fix) return;
  const CrossEdge edge = edge_of(anchor_of(index, *fix), searched.session, session);
  const double squared_distance = graph_.squared_distance(edge);
  const bool accepted = squared_distance < gate_;
  ++(accepted ? counts_[session].accepted : counts_[session].rejected);
  if (accepted) graph_.add(edge);
  if (accepted && squared_distance > kNews) graph_.optimize();
}

// From where the session was found to its end, then back to its beginning.
bool Merger::follow(const Relocalization& found, const Searched& searched,
                    const std::vector<Searched>& placed, std::size_t session) {
  place(found, searched.session, session);
  for (const KnownKeyframe& image : found.images) {
    graph_.add(edge_of(anchor_of(image.keyframe, image.fix), searched.session, session));
  }
  counts_[session] = {.accepted = found.images.size()};
  graph_.optimize();
  const auto extend_to = [&](std::size_t index) {
    const bool known =
        std::ranges::find(found.images, index, &KnownKeyframe::keyframe) != found.images.end();
    for (const Searched& other : placed) {
      if (!known || other.session != searched.session) extend(other, session, index);
    }
  };
  const std::size_t first = found.images.front().keyframe;
  for (std::size_t k = first; k < sessions_[session].places.places.size(); ++k) extend_to(k);
  for (std::size_t k = first; k-- > 0;) extend_to(k);
  graph_.optimize();
  if (counts_[session].is_enough()) return true;
  graph_.remove(session);
  return false;
}

bool Merger::find_in(const Searched& searched, const std::vector<Searched>& placed,
                     std::size_t session) {
  Relocalizer relocalizer(searched.map.sigma());
  std::size_t tries = 0;
  const std::size_t count = sessions_[session].places.places.size();
  for (std::size_t k = 0; k < count && tries < kTries; ++k) {
    const MapPlace& place = place_of(session, k);
    const auto found = relocalizer.add(k, searched.map.find(to_place(place), place.T_map_camera));
    if (!found) continue;
    if (follow(*found, searched, placed, session)) return true;
    relocalizer = Relocalizer(searched.map.sigma());
    ++tries;
  }
  return false;
}

bool Merger::find(std::size_t session) {
  const Session& own = sessions_[session];
  std::vector<Searched> placed;
  for (const std::size_t earlier : graph_.placed()) {
    if (sessions_[earlier].places.places.empty()) continue;
    placed.push_back({earlier, KnownMap(sessions_[earlier].places, own.camera, own.pixel_sigma)});
  }
  return std::ranges::any_of(
      placed, [&](const Searched& searched) { return find_in(searched, placed, session); });
}

MergedSession Merger::result(std::size_t session) const {
  MergedSession merged{.found = graph_.is_placed(session),
                       .rejected = counts_[session].rejected,
                       .path = graph_.path(session)};
  double placed = 0.0;
  double now = 0.0;
  for (const CrossEdge& edge : graph_.cross_edges()) {
    if (edge.to_session != session) continue;
    ++merged.edges;
    placed += std::pow(graph_.distance_as_placed_m(edge), 2);
    now += std::pow(graph_.distance_m(edge), 2);
  }
  const double count = std::max(1.0, static_cast<double>(merged.edges));
  merged.rms_placed_m = std::sqrt(placed / count);
  merged.rms_m = std::sqrt(now / count);
  return merged;
}

// A session may be found in one that was placed after its turn.
std::vector<MergedSession> Merger::run() {
  for (bool found = true; found;) {
    found = false;
    for (std::size_t k = 0; k < sessions_.size(); ++k) {
      if (!graph_.is_placed(k) && find(k)) found = true;
    }
  }
  std::vector<MergedSession> results;
  for (std::size_t k = 0; k < sessions_.size(); ++k) results.push_back(result(k));
  return results;
}

}  // namespace

std::vector<MergedSession> merge_sessions(const std::vector<Session>& sessions,
                                          const SessionGraph::Options& options) {
  return Merger(sessions, options).run();
}

}  // namespace apvi::loop_closure

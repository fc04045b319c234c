// SPDX-License-Identifier: BSD-3-Clause
// Ray queries of Embree, whose arguments differ between its versions 3 and 4. CMake sets
// APVI_EMBREE_MAJOR, since the headers of both versions may be installed.
#pragma once

#if APVI_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace apvi::sim {

#if APVI_EMBREE_MAJOR >= 4

inline void intersect_ray(RTCScene scene, RTCRayHit& query) {
  rtcIntersect1(scene, &query);
}

inline void occlude_ray(RTCScene scene, RTCRay& ray) {
  rtcOccluded1(scene, &ray);
}

// The rays of a packet are neighbors.
inline void intersect_packet(const int* valid, RTCScene scene, RTCRayHit8& packet) {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &packet, &arguments);
}

#else

inline void intersect_ray(RTCScene scene, RTCRayHit& query) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, &query);
}

inline void occlude_ray(RTCScene scene, RTCRay& ray) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene, &context, &ray);
}

// The rays of a packet are neighbors.
inline void intersect_packet(const int* valid, RTCScene scene, RTCRayHit8& packet) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &context, &packet);
}

#endif

}  // namespace apvi::sim

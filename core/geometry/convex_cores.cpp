#include <array>
#include <cmath>
#include <limits>

#include "core/geometry/shape.hpp"

namespace multipanda {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTouching = 1e-10;  // cores nearer than this overlap [m]

// A point of the Minkowski difference A - B, with its points of A and B.
struct Vertex {
  Vector3 w, a, b;
};

struct Difference {
  const ConvexShape& A;
  const ConvexShape& B;
  const Pose& X_AB;
  Vertex support(const Vector3& direction) const {
    const Vector3 a = A.support(direction);
    const Vector3 b = X_AB * B.support(-(X_AB.rotation.transpose() * direction));
    return {a - b, a, b};
  }
};

// The point of a simplex nearest to the origin: weights of up to four vertices.
struct Nearest {
  std::array<double, 4> weight{};
  Vector3 v = Vector3::Zero();
  double square = kInfinity;  // |v|^2
};

struct Simplex {
  std::array<Vertex, 4> vertex;
  std::size_t size = 0;

  bool has(const Vector3& w) const {
    for (std::size_t i = 0; i < size; ++i) {
      if ((vertex[i].w - w).squaredNorm() < 1e-28) return true;
    }
    return false;
  }
  void keep(Nearest& nearest) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < size; ++i) {
      if (nearest.weight[i] <= 0) continue;
      vertex[kept] = vertex[i];
      nearest.weight[kept++] = nearest.weight[i];
    }
    size = kept;
  }
};

void offer(Nearest& best, const Nearest& other) {
  if (other.square < best.square) best = other;
}

Nearest on_point(const Simplex& s, std::size_t i) {
  Nearest n;
  n.weight[i] = 1;
  n.v = s.vertex[i].w;
  n.square = n.v.squaredNorm();
  return n;
}

Nearest on_segment(const Simplex& s, std::size_t i, std::size_t j) {
  const Vector3& p = s.vertex[i].w;
  const Vector3 edge = s.vertex[j].w - p;
  const double along = -p.dot(edge), length = edge.squaredNorm();
  if (along <= 0) return on_point(s, i);
  if (along >= length) return on_point(s, j);
  Nearest n;
  const double t = along / length;
  n.weight[i] = 1 - t;
  n.weight[j] = t;
  n.v = p + t * edge;
  n.square = n.v.squaredNorm();
  return n;
}

// Inside the triangle if the projection of the origin has three positive areas, otherwise on an edge. For
// slivers, whose area is close to zero, the edges suffice.
Nearest on_triangle(const Simplex& s, std::size_t i, std::size_t j, std::size_t k) {
  const Vector3 &p = s.vertex[i].w, &q = s.vertex[j].w, &r = s.vertex[k].w;
  const Vector3 normal = (q - p).cross(r - p);
  const double area = normal.squaredNorm();
  Nearest n;
  if (area > 1e-20 * (q - p).squaredNorm() * (r - p).squaredNorm()) {
    const double at_p = normal.dot(q.cross(r)), at_q = normal.dot(r.cross(p)), at_r = normal.dot(p.cross(q));
    if (at_p > 0 && at_q > 0 && at_r > 0) {
      const double sum = at_p + at_q + at_r;
      n.weight[i] = at_p / sum;
      n.weight[j] = at_q / sum;
      n.weight[k] = at_r / sum;
      // Along the normal, which is exact even if the weights are not.
      n.v = normal * (normal.dot(p) / area);
      n.square = n.v.squaredNorm();
      return n;
    }
  }
  offer(n, on_segment(s, i, j));
  offer(n, on_segment(s, j, k));
  offer(n, on_segment(s, k, i));
  return n;
}

double volume(const Vector3& a, const Vector3& b, const Vector3& c) { return a.dot(b.cross(c)); }

bool encloses_origin(const Simplex& s) {
  const Vector3 &a = s.vertex[0].w, &b = s.vertex[1].w, &c = s.vertex[2].w, &d = s.vertex[3].w;
  const double whole = volume(b - a, c - a, d - a);
  const double at_a = volume(b, c, d), at_b = -volume(a, c, d), at_c = volume(a, b, d),
               at_d = -volume(a, b, c);
  return whole != 0 && at_a * whole >= 0 && at_b * whole >= 0 && at_c * whole >= 0 && at_d * whole >= 0;
}

Nearest nearest_to_origin(const Simplex& s) {
  switch (s.size) {
    case 1:
      return on_point(s, 0);
    case 2:
      return on_segment(s, 0, 1);
    case 3:
      return on_triangle(s, 0, 1, 2);
    default:
      break;
  }
  Nearest n;
  if (encloses_origin(s)) {
    n.square = 0;
    n.weight.fill(0.25);  // unused: the cores overlap
    return n;
  }
  offer(n, on_triangle(s, 0, 1, 2));
  offer(n, on_triangle(s, 0, 1, 3));
  offer(n, on_triangle(s, 0, 2, 3));
  offer(n, on_triangle(s, 1, 2, 3));
  return n;
}

// --- cores that overlap ---

Vector3 across(const Vector3& a) {
  Vector3 axis = Vector3::Zero();
  Eigen::Index smallest = 0;
  a.cwiseAbs().minCoeff(&smallest);
  axis[smallest] = 1;
  return a.cross(axis).normalized();
}

// Adds support points until the simplex has volume. False: the difference is flat, with this `normal`.
bool raise_to_volume(const Difference& difference, Simplex& s, Vector3& normal) {
  constexpr double kFlat = 1e-9;  // [m]
  const auto add = [&](const Vector3& direction, auto&& apart) {
    for (const double sign : {1.0, -1.0}) {
      const Vertex vertex = difference.support(sign * direction);
      if (apart(vertex.w) > kFlat) {
        s.vertex[s.size++] = vertex;
        return true;
      }
    }
    return false;
  };
  const auto& p = s.vertex[0].w;
  if (s.size == 1) {
    const auto apart = [&](const Vector3& w) { return (w - p).norm(); };
    if (!add(Vector3::UnitX(), apart) && !add(Vector3::UnitY(), apart) && !add(Vector3::UnitZ(), apart)) {
      normal = Vector3::UnitZ();
      return false;
    }
  }
  if (s.size == 2) {
    const Vector3 edge = (s.vertex[1].w - p).normalized();
    const Vector3 side = across(edge);
    const auto apart = [&](const Vector3& w) { return (w - p).cross(edge).norm(); };
    if (!add(side, apart) && !add(edge.cross(side), apart)) {
      normal = side;
      return false;
    }
  }
  if (s.size == 3) {
    normal = (s.vertex[1].w - p).cross(s.vertex[2].w - p).normalized();
    if (!add(normal, [&](const Vector3& w) { return std::abs((w - p).dot(normal)); })) return false;
  }
  return true;
}

class Polytope {
 public:
  explicit Polytope(const Simplex& s) {
    for (std::size_t i = 0; i < 4; ++i) vertex_[i] = s.vertex[i];
    vertex_count_ = 4;
    center_ = 0.25 * (vertex_[0].w + vertex_[1].w + vertex_[2].w + vertex_[3].w);
    add_face(0, 1, 2);
    add_face(0, 1, 3);
    add_face(0, 2, 3);
    add_face(1, 2, 3);
  }

  // The boundary point of the difference nearest to the origin, which lies inside.
  Closest way_out(const Difference& difference) {
    constexpr double kProgress = 1e-9;  // [m]
    Face best = nearest_face();
    while (vertex_count_ < kVertices) {
      const Vertex vertex = difference.support(best.normal);
      if (best.normal.dot(vertex.w) - best.offset < kProgress) break;
      if (!expand(vertex)) break;
      const Face next = nearest_face();
      if (next.offset == kInfinity) break;
      best = next;
    }
    return result(best);
  }

 private:
  static constexpr std::size_t kVertices = 64, kFaces = 2 * kVertices;
  using Index = std::uint8_t;
  struct Face {
    std::array<Index, 3> v{};
    Vector3 normal = Vector3::UnitZ();  // outwards
    double offset = kInfinity;          // of its plane from the origin
  };
  struct Edge {
    Index from, to;
  };

  // Orients the face outwards, using a point that is always inside.
  void add_face(Index i, Index j, Index k) {
    if (face_count_ == kFaces) return;
    Face face{{i, j, k}};
    const Vector3& p = vertex_[i].w;
    const Vector3 normal = (vertex_[j].w - p).cross(vertex_[k].w - p);
    const double area = normal.norm();
    if (area > 0) {
      face.normal = normal / area;
      if (face.normal.dot(p - center_) < 0) {
        face.normal = -face.normal;
        std::swap(face.v[1], face.v[2]);
      }
      face.offset = face.normal.dot(p);
    }  // otherwise a sliver, which is never the nearest face
    face_[face_count_++] = face;
  }

  Face nearest_face() const {
    Face best;
    for (std::size_t i = 0; i < face_count_; ++i) {
      if (face_[i].offset < best.offset) best = face_[i];
    }
    return best;
  }

  // Replaces the faces that are visible from the new vertex by faces from their rim to it.
  bool expand(const Vertex& vertex) {
    std::array<Edge, 3 * kFaces> rim;
    std::size_t rim_size = 0, kept = 0;
    for (std::size_t i = 0; i < face_count_; ++i) {
      const Face& face = face_[i];
      if (face.normal.dot(vertex.w - vertex_[face.v[0]].w) <= 1e-13) {
        face_[kept++] = face;
        continue;
      }
      for (std::size_t k = 0; k < 3; ++k) {
        const Edge edge{face.v[k], face.v[(k + 1) % 3]};
        std::size_t twin = 0;
        while (twin < rim_size && !(rim[twin].from == edge.to && rim[twin].to == edge.from)) ++twin;
        if (twin < rim_size) {
          rim[twin] = rim[--rim_size];
        } else {
          rim[rim_size++] = edge;
        }
      }
    }
    if (kept == face_count_ || rim_size == 0 || kept + rim_size > kFaces) return false;
    face_count_ = kept;
    const auto added = static_cast<Index>(vertex_count_);
    vertex_[vertex_count_++] = vertex;
    for (std::size_t i = 0; i < rim_size; ++i) add_face(rim[i].from, rim[i].to, added);
    return true;
  }

  // A flat side of the difference has several coplanar triangles; the nearest point is in one of them.
  Closest result(const Face& best) const {
    Simplex nearest_triangle;
    Nearest nearest;
    for (std::size_t i = 0; i < face_count_; ++i) {
      if (face_[i].offset > best.offset + 1e-9) continue;
      Simplex s;
      s.size = 3;
      for (std::size_t k = 0; k < 3; ++k) s.vertex[k] = vertex_[face_[i].v[k]];
      const Nearest n = on_triangle(s, 0, 1, 2);
      if (n.square >= nearest.square) continue;
      nearest = n;
      nearest_triangle = s;
    }
    Closest closest;
    closest.distance = -std::max(0.0, best.offset);
    for (std::size_t k = 0; k < 3; ++k) {
      closest.p_A += nearest.weight[k] * nearest_triangle.vertex[k].a;
      closest.p_B += nearest.weight[k] * nearest_triangle.vertex[k].b;
    }
    closest.normal =
        -best.normal;  // A's deepest point lies along the normal of the face, so A moves the other way
    return closest;
  }

  std::array<Vertex, kVertices> vertex_;
  std::array<Face, kFaces> face_;
  std::size_t vertex_count_ = 0, face_count_ = 0;
  Vector3 center_ = Vector3::Zero();
};

Closest overlap(const Difference& difference, Simplex s) {
  Vector3 normal = Vector3::UnitZ();
  if (!raise_to_volume(difference, s, normal)) {
    Closest closest;
    closest.p_A = s.vertex[0].a;
    closest.p_B = s.vertex[0].a;
    closest.normal = normal;
    return closest;
  }
  return Polytope(s).way_out(difference);
}

}  // namespace

Closest closest_cores(const ConvexShape& A, const ConvexShape& B, const Pose& X_AB) {
  constexpr int kRounds = 64;
  constexpr double kRelative = 1e-14;  // of |v|^2: where the lower bound meets the distance
  const Difference difference{A, B, X_AB};
  Simplex s;
  s.vertex[0] = difference.support(-X_AB.position);
  s.size = 1;
  Nearest nearest = on_point(s, 0);
  for (int round = 0; round < kRounds; ++round) {
    if (nearest.square < kTouching * kTouching) return overlap(difference, s);
    const Vertex next = difference.support(-nearest.v);
    // No point of the difference lies farther towards the origin than `next`: |v|^2 - v.w bounds the error.
    if (nearest.square - nearest.v.dot(next.w) <= kRelative * nearest.square || s.has(next.w)) break;
    Simplex larger = s;
    larger.vertex[larger.size++] = next;
    Nearest better = nearest_to_origin(larger);
    if (better.square == 0 && larger.size == 4) return overlap(difference, larger);
    if (better.square >= nearest.square) break;  // rounding limit reached
    larger.keep(better);
    s = larger;
    nearest = better;
  }
  Closest closest;
  for (std::size_t i = 0; i < s.size; ++i) {
    closest.p_A += nearest.weight[i] * s.vertex[i].a;
    closest.p_B += nearest.weight[i] * s.vertex[i].b;
  }
  closest.distance = std::sqrt(nearest.square);
  closest.normal = nearest.v / closest.distance;
  return closest;
}

}  // namespace multipanda

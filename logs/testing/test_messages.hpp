#pragma once

#include <random>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "logs/cdr.hpp"
#include "logs/messages.hpp"

// Fillers for any message, for tests only.
namespace multipanda {

namespace msg {
inline bool operator==(const Time& a, const Time& b) { return a.fields() == b.fields(); }
inline bool operator==(const Point& a, const Point& b) { return a.fields() == b.fields(); }
inline bool operator==(const Vector3& a, const Vector3& b) { return a.fields() == b.fields(); }
inline bool operator==(const Quaternion& a, const Quaternion& b) { return a.fields() == b.fields(); }
inline bool operator==(const Pose& a, const Pose& b) { return a.fields() == b.fields(); }
inline bool operator==(const Twist& a, const Twist& b) { return a.fields() == b.fields(); }
inline bool operator==(const Wrench& a, const Wrench& b) { return a.fields() == b.fields(); }
inline bool operator==(const OutputValues& a, const OutputValues& b) { return a.fields() == b.fields(); }
}  // namespace msg

// Visits every primitive of a message in order; `leaf` sets it to a number or a string.
template <typename Leaf>
class Filler {
 public:
  explicit Filler(Leaf leaf) : leaf_(leaf) {}
  template <RosMessage M>
  void fill(M& message) {
    std::apply([this](auto&... field) { (this->put(field), ...); }, message.fields());
  }

 private:
  template <typename T>
  void put(T& field) {
    if constexpr (RosMessage<T>) {
      fill(field);
    } else if constexpr (std::is_arithmetic_v<T> || std::is_same_v<T, std::string>) {
      leaf_(field);
    } else {
      if constexpr (requires { field.resize(1); }) field.resize(leaf_.length());
      for (std::size_t i = 0; i < field.size(); ++i) {
        typename T::value_type element{};
        put(element);
        field[i] = element;
      }
    }
  }
  Leaf leaf_;
};

class RandomLeaf {
 public:
  explicit RandomLeaf(std::mt19937& random) : random_(&random) {}
  void operator()(std::string& s) {
    s.clear();
    for (std::size_t n = length(); n > 0; --n) s += static_cast<char>('a' + (*random_)() % 26);
  }
  void operator()(bool& b) { b = (*random_)() % 2 == 0; }
  template <typename T>
  void operator()(T& value) {
    if constexpr (std::is_floating_point_v<T>) {
      value = std::uniform_real_distribution<T>(-1, 1)(*random_);
    } else {
      value = static_cast<T>((std::uint64_t{(*random_)()} << 32) ^ (*random_)());
    }
  }
  std::size_t length() { return (*random_)() % 5; }

 private:
  std::mt19937* random_;
};

struct RandomFiller : Filler<RandomLeaf> {
  explicit RandomFiller(std::mt19937& random) : Filler(RandomLeaf(random)) {}
};

// Counts: the k-th primitive of a message gets k plus `first`, in its own type; strings are "t<k>"; a bool is
// true for odd k; sequences have `first % 4` elements. read_back_test.py follows the same rule.
class CountingLeaf {
 public:
  explicit CountingLeaf(int first) : first_(first), next_(first) {}
  void operator()(std::string& s) { s = std::string(1, 't').append(std::to_string(next_++)); }
  void operator()(bool& b) { b = next_++ % 2 != 0; }
  template <typename T>
  void operator()(T& value) {
    if constexpr (std::is_floating_point_v<T>) {
      value = static_cast<T>(next_++) + T(0.25);
    } else {
      value = static_cast<T>(next_++ % 100);
    }
  }
  std::size_t length() const { return static_cast<std::size_t>(first_ % 4); }

 private:
  int first_, next_;
};

struct CountingFiller : Filler<CountingLeaf> {
  explicit CountingFiller(int first) : Filler(CountingLeaf(first)) {}
};

}  // namespace multipanda

#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>
#include <string_view>
#include <type_traits>

// A message is described once, by a function `carry(archive, message, dialect)` that names its fields in the
// order of the wire. The archive decides the operation: write, read or count bytes, or find a field. So both
// ends, and the sizes and offsets checked at compile time, always agree.
//
// The wire is little-endian and without padding. Numbers are doubles in memory; the archive's `single`
// determines their width on the wire (only the arm's state, from version 10 on). Archives neither allocate
// nor throw.
namespace multipanda::fci {

static_assert(std::endian::native == std::endian::little, "the wire is little-endian and copied unchanged");
static_assert(std::numeric_limits<double>::is_iec559 && std::numeric_limits<float>::is_iec559);

// Result of reading or writing bytes.
enum class WireResult : std::uint8_t {
  ok,
  too_short,  // fewer bytes than the message, or no space for it
  too_long,   // more bytes than the message has
  bad_value,  // a field holds a value that the protocol does not define
};

// A message of this type, written or read: `carry(auto& archive, MessageOf<MoveRequest> auto& message)`.
template <typename T, typename Message>
concept MessageOf = std::same_as<std::remove_const_t<T>, Message>;

class Writer {
 public:
  explicit Writer(std::span<std::byte> to, bool single = false) : to_(to), single_(single) {}

  template <std::integral T>
  void integer(std::string_view, T value) {
    put(value);
  }
  template <class E>
  void choice(std::string_view, E value, E) {
    put(static_cast<std::underlying_type_t<E>>(value));
  }
  void flag(std::string_view, bool value) { put(static_cast<std::uint8_t>(value ? 1 : 0)); }
  void number(std::string_view, double value) {
    if (single_)
      put(static_cast<float>(value));
    else
      put(value);
  }
  template <std::size_t N>
  void numbers(std::string_view name, const std::array<double, N>& values) {
    for (const double value : values) number(name, value);
  }
  template <std::size_t N>
  void flags(std::string_view, const std::array<std::uint8_t, N>& values, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) put(values[i]);
  }

  WireResult result() const { return result_; }
  std::size_t size() const { return at_; }  // [bytes] written

 private:
  template <class T>
  void put(T value) {
    if (to_.size() - at_ < sizeof(T)) {
      result_ = WireResult::too_short;
      return;
    }
    std::memcpy(to_.data() + at_, &value, sizeof(T));
    at_ += sizeof(T);
  }

  std::span<std::byte> to_;
  std::size_t at_ = 0;
  WireResult result_ = WireResult::ok;
  bool single_;
};

// After a missing or invalid field, the rest of the message stays unchanged.
class Reader {
 public:
  explicit Reader(std::span<const std::byte> from, bool single = false) : from_(from), single_(single) {}

  template <std::integral T>
  void integer(std::string_view, T& value) {
    get(value);
  }
  // `last`: the highest value that is defined.
  template <class E>
  void choice(std::string_view, E& value, E last) {
    std::underlying_type_t<E> raw = 0;
    if (!get(raw)) return;
    if (raw > static_cast<std::underlying_type_t<E>>(last)) {
      result_ = WireResult::bad_value;
      return;
    }
    value = static_cast<E>(raw);
  }
  void flag(std::string_view, bool& value) {
    std::uint8_t raw = 0;
    if (get(raw)) value = raw != 0;
  }
  void number(std::string_view, double& value) {
    if (!single_) {
      get(value);
      return;
    }
    float raw = 0;
    if (get(raw)) value = static_cast<double>(raw);
  }
  template <std::size_t N>
  void numbers(std::string_view name, std::array<double, N>& values) {
    for (double& value : values) number(name, value);
  }
  template <std::size_t N>
  void flags(std::string_view, std::array<std::uint8_t, N>& values, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) get(values[i]);
  }

  // With `exact`, remaining bytes are an error.
  WireResult result(bool exact) const {
    return result_ == WireResult::ok && exact && at_ < from_.size() ? WireResult::too_long : result_;
  }

 private:
  template <class T>
  bool get(T& value) {
    if (result_ != WireResult::ok) return false;
    if (from_.size() - at_ < sizeof(T)) {
      result_ = WireResult::too_short;
      return false;
    }
    std::memcpy(&value, from_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return true;
  }

  std::span<const std::byte> from_;
  std::size_t at_ = 0;
  WireResult result_ = WireResult::ok;
  bool single_;
};

// Counts bytes, and finds the offset of the field with a given name.
class Measure {
 public:
  static constexpr std::size_t kNowhere = static_cast<std::size_t>(-1);

  constexpr explicit Measure(std::string_view requested = {}, bool single = false)
      : requested_(requested), number_(single ? sizeof(float) : sizeof(double)) {}

  template <std::integral T>
  constexpr void integer(std::string_view name, const T&) {
    pass(name, sizeof(T));
  }
  template <class E>
  constexpr void choice(std::string_view name, const E&, E) {
    pass(name, sizeof(E));
  }
  constexpr void flag(std::string_view name, bool) { pass(name, 1); }
  constexpr void number(std::string_view name, double) { pass(name, number_); }
  template <std::size_t N>
  constexpr void numbers(std::string_view name, const std::array<double, N>&) {
    pass(name, N * number_);
  }
  template <std::size_t N>
  constexpr void flags(std::string_view name, const std::array<std::uint8_t, N>&, std::size_t count) {
    pass(name, count);
  }

  constexpr std::size_t size() const { return size_; }  // [bytes]
  constexpr std::size_t found() const { return found_; }

 private:
  constexpr void pass(std::string_view name, std::size_t bytes) {
    if (name == requested_) found_ = size_;
    size_ += bytes;
  }

  std::string_view requested_;
  std::size_t number_;
  std::size_t size_ = 0;
  std::size_t found_ = kNowhere;
};

}  // namespace multipanda::fci

#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <vector>

// CDR, little-endian: the serialization of ROS 2 messages (OMG CDR, as used by DDS-RTPS). A 4-byte header 00
// 01 00 00 precedes the fields in order. Each primitive is aligned to its own size, counted from the end of
// the header. Strings have a u32 length (NUL included) and bytes, sequences a u32 count and elements, fixed
// arrays only elements.
namespace multipanda {

// A generated message struct: see generate_messages.py.
template <typename T>
concept RosMessage = requires(const T& m) {
  T::kType;
  T::kText;
  m.fields();
};

template <typename T>
concept CdrPrimitive = std::is_arithmetic_v<T>;

class CdrWriter {
 public:
  // Returns the serialized message, valid until the next call. The buffer is reused, so that steady use does
  // not allocate.
  template <RosMessage M>
  std::span<const std::uint8_t> write(const M& message) {
    buffer_.assign(kHeader.begin(), kHeader.end());
    put(message);
    return buffer_;
  }

 private:
  static constexpr std::array<std::uint8_t, 4> kHeader = {0, 1, 0, 0};

  void align(std::size_t size) { buffer_.resize(kHeader.size() + (offset() + size - 1) / size * size); }
  std::size_t offset() const { return buffer_.size() - kHeader.size(); }
  void put_bytes(const void* data, std::size_t size) {
    const std::size_t at = buffer_.size();
    buffer_.resize(at + size);
    if (size > 0) std::memcpy(buffer_.data() + at, data, size);
  }

  template <CdrPrimitive T>
  void put(T value) {
    align(sizeof(T));
    put_bytes(&value, sizeof(T));
  }
  void put(const std::string& text);
  template <typename T>
  void put(const std::vector<T>& values) {
    put(static_cast<std::uint32_t>(values.size()));
    put_elements(values);
  }
  template <typename T, std::size_t N>
  void put(const std::array<T, N>& values) {
    put_elements(values);
  }
  template <RosMessage M>
  void put(const M& message) {
    std::apply([this](const auto&... field) { (this->put(field), ...); }, message.fields());
  }
  template <typename Range>
  void put_elements(const Range& values) {
    using T = typename Range::value_type;
    if constexpr (CdrPrimitive<T> && !std::same_as<T, bool>) {  // std::vector<bool> has no bytes to copy
      if (values.empty()) return;                               // without elements there is no alignment
      align(sizeof(T));
      put_bytes(values.data(), values.size() * sizeof(T));
    } else {
      for (const auto& value : values) put(static_cast<const T&>(value));
    }
  }

  std::vector<std::uint8_t> buffer_;
};

// Reads what CdrWriter writes. Throws std::runtime_error if the bytes end too early or are not valid CDR.
class CdrReader {
 public:
  explicit CdrReader(std::span<const std::uint8_t> bytes);

  template <RosMessage M>
  void read(M& message) {
    get(message);
  }

 private:
  std::span<const std::uint8_t> take(std::size_t size, std::size_t alignment);

  template <CdrPrimitive T>
  void get(T& value) {
    const auto bytes = take(sizeof(T), sizeof(T));
    if constexpr (std::same_as<T, bool>) {
      value = bytes[0] != 0;
    } else {
      std::memcpy(&value, bytes.data(), sizeof(T));
    }
  }
  void get(std::string& text);
  template <typename T>
  void get(std::vector<T>& values) {
    std::uint32_t count = 0;
    get(count);
    // Every element takes at least one byte, so a damaged count cannot request gigabytes.
    if (count > bytes_.size()) throw std::runtime_error("CDR: a sequence is longer than its message");
    values.resize(count);
    get_elements(values);
  }
  template <typename T, std::size_t N>
  void get(std::array<T, N>& values) {
    get_elements(values);
  }
  template <RosMessage M>
  void get(M& message) {
    std::apply([this](auto&... field) { (this->get(field), ...); }, message.fields());
  }
  template <typename Range>
  void get_elements(Range& values) {
    using T = typename Range::value_type;
    if constexpr (std::same_as<T, bool>) {
      for (std::size_t i = 0; i < values.size(); ++i) {
        bool value = false;
        get(value);
        values[i] = value;
      }
    } else if constexpr (CdrPrimitive<T>) {
      if (values.empty()) return;
      const auto bytes = take(values.size() * sizeof(T), sizeof(T));
      std::memcpy(values.data(), bytes.data(), bytes.size());
    } else {
      for (T& value : values) get(value);
    }
  }

  std::span<const std::uint8_t> bytes_;  // after the header
  std::size_t offset_ = 0;
};

template <RosMessage M>
M from_cdr(std::span<const std::uint8_t> bytes) {
  M message;
  CdrReader(bytes).read(message);
  return message;
}

}  // namespace multipanda

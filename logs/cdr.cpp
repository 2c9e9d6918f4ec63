#include "logs/cdr.hpp"

#include <bit>

namespace multipanda {

static_assert(std::endian::native == std::endian::little, "CDR is written in the machine's own byte order");

void CdrWriter::put(const std::string& text) {
  put(static_cast<std::uint32_t>(text.size() + 1));
  put_bytes(text.c_str(), text.size() + 1);
}

CdrReader::CdrReader(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < 4 || bytes[0] != 0 || bytes[1] != 1) {
    throw std::runtime_error("CDR: expected the header 00 01 (little-endian plain CDR)");
  }
  bytes_ = bytes.subspan(4);
}

std::span<const std::uint8_t> CdrReader::take(std::size_t size, std::size_t alignment) {
  const std::size_t at = (offset_ + alignment - 1) / alignment * alignment;
  if (at > bytes_.size() || size > bytes_.size() - at) {
    throw std::runtime_error("CDR: the message ends inside a field");
  }
  offset_ = at + size;
  return bytes_.subspan(at, size);
}

void CdrReader::get(std::string& text) {
  std::uint32_t length = 0;
  get(length);
  const auto bytes = take(length, 1);
  if (length == 0 || bytes.back() != 0) throw std::runtime_error("CDR: a string does not end with NUL");
  text.assign(reinterpret_cast<const char*>(bytes.data()), length - 1);
}

}  // namespace multipanda

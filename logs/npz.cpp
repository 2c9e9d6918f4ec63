#include "logs/npz.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "logs/mcap_format.hpp"

namespace multipanda {
namespace {

// kCrcTables[k][i]: of byte i followed by k zeros, so that eight bytes take one step.
constexpr auto kCrcTables = [] {
  std::array<std::array<std::uint32_t, 256>, 8> tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t c = i;
    for (int bit = 0; bit < 8; ++bit) c = (c & 1u) != 0 ? 0xEDB88320u ^ (c >> 1) : c >> 1;
    tables[0][i] = c;
  }
  for (std::size_t k = 1; k < 8; ++k) {
    for (std::size_t i = 0; i < 256; ++i)
      tables[k][i] = tables[0][tables[k - 1][i] & 0xFFu] ^ (tables[k - 1][i] >> 8);
  }
  return tables;
}();

// CRC-32 as in zip; `crc` continues an earlier one.
std::uint32_t crc32(std::string_view bytes, std::uint32_t crc) {
  crc = ~crc;
  for (; bytes.size() >= 8; bytes.remove_prefix(8)) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes.data(), 8);
    word ^= crc;
    crc = 0;
    for (std::size_t k = 0; k < 8; ++k) crc ^= kCrcTables[7 - k][word >> (8 * k) & 0xFFu];
  }
  for (const char c : bytes) crc = kCrcTables[0][(crc ^ static_cast<std::uint8_t>(c)) & 0xFFu] ^ (crc >> 8);
  return ~crc;
}

// Version 1.0: magic, length, a Python dict padded with blanks to a multiple of 64, newline.
std::string npy_header(const NpzWriter::Array& a) {
  std::string dict = "{'descr': '";
  switch (a.kind) {
    case NpzWriter::Kind::real:
      dict += "<f8";
      break;
    case NpzWriter::Kind::integer:
      dict += "<i8";
      break;
    case NpzWriter::Kind::text:
      dict.append("<U").append(std::to_string(a.width));
      break;
  }
  dict.append("', 'fortran_order': False, 'shape': (").append(std::to_string(a.rows)).append(",");
  if (a.matrix && a.kind != NpzWriter::Kind::text) dict.append(" ").append(std::to_string(a.width));
  dict += "), }";
  dict.append(63 - (10 + dict.size()) % 64, ' ');
  dict += '\n';
  mcap::Encoder out;
  out.raw(std::string_view("\x93NUMPY\x01\x00", 8)).put(static_cast<std::uint16_t>(dict.size())).raw(dict);
  return std::string(out.bytes());
}

constexpr std::uint16_t kZipVersion = 20;
constexpr std::uint16_t kZipDate = (1u << 5) | 1u;  // 1980-01-01: equal logs give equal files

std::string entry_name(const NpzWriter::Array& array) { return array.name + ".npy"; }

}  // namespace

std::u32string code_points(std::string_view utf8) {
  std::u32string out;
  for (std::size_t i = 0; i < utf8.size();) {
    const auto byte = static_cast<std::uint8_t>(utf8[i]);
    const std::size_t length = byte < 0x80       ? 1
                               : byte >> 5 == 6  ? 2
                               : byte >> 4 == 14 ? 3
                               : byte >> 3 == 30 ? 4
                                                 : 0;
    char32_t point = length == 1 ? byte : byte & (0x7Fu >> length);
    bool valid = length > 0 && i + length <= utf8.size();
    for (std::size_t k = 1; valid && k < length; ++k) {
      const auto next = static_cast<std::uint8_t>(utf8[i + k]);
      valid = next >> 6 == 2;
      point = point << 6 | (next & 0x3Fu);
    }
    out += valid ? point : U'\uFFFD';
    i += valid ? length : 1;
  }
  return out;
}

std::size_t code_point_count(std::string_view utf8) {
  const bool ascii = std::ranges::all_of(utf8, [](char c) { return static_cast<std::uint8_t>(c) < 0x80; });
  return ascii ? utf8.size() : code_points(utf8).size();
}

std::size_t NpzWriter::Entry::row_bytes() const { return array.width * (array.kind == Kind::text ? 4 : 8); }

NpzWriter::NpzWriter(const std::filesystem::path& path, std::vector<Array> arrays)
    : path_(path), file_(path, std::ios::binary | std::ios::trunc) {
  if (!file_)
    throw std::runtime_error("cannot create " + path.string() +
                             "; check that the folder exists and is writable");
  std::uint64_t offset = 0;
  for (Array& array : arrays) {
    if (array.kind == Kind::text) array.width = std::max<std::size_t>(array.width, 1);  // numpy has no <U0
    Entry entry;
    entry.header = npy_header(array);
    entry.array = std::move(array);
    entry.offset = offset;
    entry.crc = crc32(entry.header, 0);
    offset += local_header(entry).size() + entry.file_bytes();
    entries_.push_back(std::move(entry));
  }
  directory_ = offset;
  if (offset > std::numeric_limits<std::uint32_t>::max() / 16 * 15) {
    throw std::runtime_error("the arrays would exceed 4 GiB, which " + path.string() +
                             " cannot hold; export to CSV or record a shorter run");
  }
}

template <typename T>
void NpzWriter::add_numbers(std::size_t index, const std::vector<T>& row, T missing) {
  Entry& entry = entries_.at(index);
  const std::size_t count = std::min(row.size(), entry.array.width);
  add_bytes(entry, {reinterpret_cast<const char*>(row.data()), count * sizeof(T)});
  for (std::size_t i = count; i < entry.array.width; ++i)
    add_bytes(entry, {reinterpret_cast<const char*>(&missing), sizeof(missing)});
}

void NpzWriter::add(std::size_t index, const std::vector<double>& row) {
  add_numbers(index, row, std::numeric_limits<double>::quiet_NaN());
}

void NpzWriter::add(std::size_t index, const std::vector<std::int64_t>& row) {
  add_numbers(index, row, std::int64_t{0});
}

void NpzWriter::add(std::size_t index, std::string_view utf8) {
  Entry& entry = entries_.at(index);
  if (entry.points.empty() || utf8 != entry.text) {
    entry.text = utf8;
    entry.points = code_points(utf8);
    entry.points.resize(entry.array.width, U'\0');
  }
  add_bytes(entry,
            {reinterpret_cast<const char*>(entry.points.data()), entry.points.size() * sizeof(char32_t)});
}

void NpzWriter::add_bytes(Entry& entry, std::string_view bytes) {
  entry.buffer += bytes;
  if (entry.buffer.size() >= 64u << 10) flush(entry);
}

void NpzWriter::flush(Entry& entry) {
  const std::uint64_t data = entry.offset + local_header(entry).size() + entry.header.size();
  file_.seekp(static_cast<std::streamoff>(data + entry.written));
  file_ << entry.buffer;
  entry.crc = crc32(entry.buffer, entry.crc);
  entry.written += entry.buffer.size();
  entry.buffer.clear();
}

std::string NpzWriter::local_header(const Entry& entry) const {
  const std::string name = entry_name(entry.array);
  const auto size = static_cast<std::uint32_t>(entry.file_bytes());
  mcap::Encoder out;
  out.put(std::uint32_t{0x04034b50}).put(kZipVersion).put(std::uint16_t{0}).put(std::uint16_t{0});
  out.put(std::uint16_t{0}).put(kZipDate).put(entry.crc).put(size).put(size);
  out.put(static_cast<std::uint16_t>(name.size())).put(std::uint16_t{0}).raw(name);
  return std::string(out.bytes());
}

void NpzWriter::close() {
  mcap::Encoder directory;
  for (Entry& entry : entries_) {
    flush(entry);
    if (entry.written != entry.array.rows * entry.row_bytes()) {
      throw std::runtime_error(path_.string() + ": rows of " + entry.array.name + " are missing");
    }
    file_.seekp(static_cast<std::streamoff>(entry.offset));
    file_ << local_header(entry) << entry.header;

    const std::string name = entry_name(entry.array);
    const auto size = static_cast<std::uint32_t>(entry.file_bytes());
    directory.put(std::uint32_t{0x02014b50}).put(kZipVersion).put(kZipVersion).put(std::uint16_t{0});
    directory.put(std::uint16_t{0}).put(std::uint16_t{0}).put(kZipDate).put(entry.crc).put(size).put(size);
    directory.put(static_cast<std::uint16_t>(name.size())).put(std::uint16_t{0}).put(std::uint16_t{0});
    directory.put(std::uint16_t{0}).put(std::uint16_t{0}).put(std::uint32_t{0});
    directory.put(static_cast<std::uint32_t>(entry.offset)).raw(name);
  }
  const auto count = static_cast<std::uint16_t>(entries_.size());
  mcap::Encoder end;
  end.put(std::uint32_t{0x06054b50}).put(std::uint16_t{0}).put(std::uint16_t{0}).put(count).put(count);
  end.put(static_cast<std::uint32_t>(directory.bytes().size())).put(static_cast<std::uint32_t>(directory_));
  end.put(std::uint16_t{0});
  file_.seekp(static_cast<std::streamoff>(directory_));
  file_ << directory.bytes() << end.bytes();
  file_.close();
  if (!file_)
    throw std::runtime_error("cannot write " + path_.string() + "; check that the disk is not full");
}

}  // namespace multipanda

#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace multipanda {

// Writes numpy's .npz: a zip archive of .npy arrays without compression. All shapes are known before the
// first value, so each array has a fixed place in the file and rows of all arrays may come in any order.
// Memory use does not grow with the log. Both formats are public: numpy.lib.format, and PKWARE's APPNOTE
// for zip.
class NpzWriter {
 public:
  enum class Kind { real, integer, text };  // float64, int64, unicode

  struct Array {
    std::string name;  // "left/state/q"
    Kind kind = Kind::real;
    std::size_t rows = 0;
    std::size_t width = 1;  // numbers per row; for a text: code points
    bool matrix = false;    // shape (rows, width); otherwise (rows,), as for every text
  };

  // Throws std::runtime_error if the file cannot be created or would exceed 4 GiB.
  NpzWriter(const std::filesystem::path& path, std::vector<Array> arrays);

  // Adds the next row of array `index`. Shorter rows are filled with NaN, 0 or empty text; longer
  // ones are cut.
  void add(std::size_t index, const std::vector<double>& row);
  void add(std::size_t index, const std::vector<std::int64_t>& row);
  void add(std::size_t index, std::string_view utf8);

  void close();  // throws std::runtime_error if the disk is full or rows are missing

 private:
  struct Entry {
    Array array;
    std::string header;         // .npy header
    std::uint64_t offset = 0;   // of the zip entry
    std::uint64_t written = 0;  // bytes of the array's data
    std::uint32_t crc = 0;
    std::string buffer;
    std::string text;  // of the latest row
    std::u32string points;
    std::size_t row_bytes() const;
    std::uint64_t file_bytes() const { return header.size() + array.rows * row_bytes(); }
  };
  template <typename T>
  void add_numbers(std::size_t index, const std::vector<T>& row, T missing);
  void add_bytes(Entry& entry, std::string_view bytes);
  void flush(Entry& entry);
  std::string local_header(const Entry& entry) const;

  std::filesystem::path path_;
  std::ofstream file_;
  std::vector<Entry> entries_;
  std::uint64_t directory_ = 0;
};

// Code points of a UTF-8 text; bytes that are not UTF-8 become U+FFFD.
std::u32string code_points(std::string_view utf8);

// Length of code_points(utf8), the width of a text array.
std::size_t code_point_count(std::string_view utf8);

}  // namespace multipanda

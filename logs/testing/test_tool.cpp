// Runs the library for read_back_test.py, so that other libraries can read the result.
//   write FILE COUNT   COUNT messages of every type, filled by counting
//   open FILE COUNT    the same, but ends without closing the file
//   repair FILE | csv LOG DIRECTORY | npz LOG FILE
#include <cstdio>
#include <cstdlib>
#include <string>

#include "logs/export.hpp"
#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "logs/testing/test_messages.hpp"

namespace multipanda {
namespace {

template <typename M>
void write_counted(McapWriter& writer, int count) {
  const std::string type(M::kType);
  const std::uint16_t channel = writer.add_channel<M>("/test/" + type.substr(type.rfind('/') + 1));
  for (int i = 0; i < count; ++i) {
    M message;
    CountingFiller(i).fill(message);
    writer.write(channel, 1'000'000LL * i, message);
  }
}

void write_all(McapWriter& writer, int count) {
  writer.add(mcap::Attachment{0, 0, "scene.yaml", "application/yaml", "arms: []\n"});
  writer.add(mcap::Metadata{"run", {{"scene", "test"}, {"version", "0"}}});
  [&]<typename... M>(std::type_identity<std::tuple<M...>>) {
    (write_counted<M>(writer, count), ...);
  }(std::type_identity<msg::OwnMessages>{});
}

int run(const std::vector<std::string>& words) {
  const std::string& command = words.at(0);
  if (command == "write" || command == "open") {
    McapWriter writer(words.at(1), {.chunk_bytes = 20000});
    write_all(writer, std::stoi(words.at(2)));
    if (command == "open") std::_Exit(0);  // as if killed
    return writer.close().closed ? 0 : 1;
  }
  if (command == "repair") {
    std::printf("%llu\n", static_cast<unsigned long long>(repair_log(words.at(1)).messages));
  } else if (command == "csv") {
    (void)export_csv(words.at(1), words.at(2));
  } else if (command == "npz") {
    (void)export_npz(words.at(1), words.at(2));
  } else {
    return 2;
  }
  return 0;
}

}  // namespace
}  // namespace multipanda

int main(int argc, char** argv) {
  try {
    return multipanda::run({argv + 1, argv + argc});
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
  }
}

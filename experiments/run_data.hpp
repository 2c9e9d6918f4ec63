#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Collects the data for the figures during a run: the arrays that export_npz makes of its log. Names and
// meaning are those of the export (docs/logs.md). Integers are stored as floating point, and arrays that no
// figure needs are left out.
class RunData {
 public:
  // `model_every`: cycles between two evaluations of the model, as in the log.
  RunData(const Scene& scene, const RecordLayout& layout,
          const std::vector<std::shared_ptr<const ArmModel>>& models, std::uint64_t model_every);

  void take(const CycleRecord& record);  // one thread
  void write(const std::filesystem::path& file) const;

 private:
  struct Numbers {
    std::string name;
    std::size_t width = 1;
    bool matrix = false;
    std::vector<double> values;
  };
  struct Owners {
    std::string name;
    std::vector<std::uint16_t> values;
  };
  struct Arm {
    std::size_t joints = 0;
    std::size_t first = 0;        // of its columns in columns_
    std::size_t first_model = 0;  // of its model columns
    ModelTerms terms;
  };
  struct Series {  // an input, or an output
    std::size_t first = 0;
    std::size_t offset = 0, size = 0;
    bool seen = false;
    std::string topic, kind, frame;
  };

  std::size_t column(const std::string& name, std::size_t width, bool matrix);
  void put(std::size_t index, double value) { columns_[index].values.push_back(value); }
  void put(std::size_t index, const double* values, std::size_t count);
  void take_arm(std::size_t index, const CycleRecord& record);

  std::uint64_t model_every_;
  RecordLayout layout_;
  std::vector<Numbers> columns_;
  std::vector<Owners> owners_;
  std::vector<Arm> arms_;
  std::vector<std::vector<Series>> inputs_;
  std::vector<Series> outputs_;
};

}  // namespace multipanda

#include "experiments/schema.hpp"

namespace multipanda::experiment_schema {
namespace {

Field text(const char* key, const char* doc, bool required = false) {
  return {.key = key, .required = required, .doc = doc};
}
Field name(const char* key, const char* doc, bool required = true) {
  return {.key = key, .kind = FieldKind::identifier, .required = required, .doc = doc};
}
Field names(const char* key, const char* doc) { return {.key = key, .kind = FieldKind::texts, .doc = doc}; }
Field open(const char* key, const char* doc) { return {.key = key, .kind = FieldKind::open, .doc = doc}; }
Field list(const char* key, const Section& section, const char* doc) {
  return {.key = key, .kind = FieldKind::sections, .section = &section, .doc = doc};
}
Field part(const char* key, const Section& section, const char* doc) {
  return {.key = key, .kind = FieldKind::section, .section = &section, .doc = doc};
}

}  // namespace

const Section& variant() {
  static const Section section{"Variant",
                               "One way to run the experiment.",
                               {name("name", "Unique; in file names and limits."),
                                text("label", "For people; without it the name."),
                                open("set", "Values put into the scene, by key path."),
                                {.key = "reported",
                                 .kind = FieldKind::boolean,
                                 .fallback = "false",
                                 .doc = "`true`: shown, held to no limit that does not name it."}}};
  return section;
}

const Section& axis() {
  static const Section section{"Axis",
                               "Choices of one kind; every combination of all axes is a variant.",
                               {name("name", "What is chosen."), list("choices", variant(), "The choices.")}};
  return section;
}

const Section& variation() {
  static const Section section{"Variation",
                               "Moves a number of the scene, or each of a list, in every repeat.",
                               {text("key", "Key path.", true),
                                {.key = "by",
                                 .kind = FieldKind::number,
                                 .required = true,
                                 .min = 0,
                                 .doc = "Uniformly within +- this."}}};
  return section;
}

const Section& limit() {
  static const Section section{
      "Limit",
      "What a figure must not exceed or must reach, in the worst repeat.",
      {text("metric", "Name of the figure.", true), open("at_most", "A number, or one per plant."),
       open("at_least", "A number, or one per plant."),
       names("variants", "Names of variants or choices; without: all but the reported.")}};
  return section;
}

const Section& published() {
  static const Section section{
      "Published",
      "A figure that somebody else published for the same.",
      {text("metric", "Which of ours corresponds; may be left out."),
       {.key = "value", .kind = FieldKind::number, .doc = "In the unit of the metric."},
       text("text", "What it is and where it stands.", true)}};
  return section;
}

const Section& window() {
  static const Section section{"Window",
                               "The time that the figures are of.",
                               {{.key = "after",
                                 .kind = FieldKind::choice,
                                 .fallback = "start",
                                 .choices = {"start", "contact", "motion"},
                                 .doc = "Begins after the start, after every arm in `force` has touched, or "
                                        "with the timeline's first motion."},
                                {.key = "offset_s",
                                 .kind = FieldKind::number,
                                 .unit = "s",
                                 .fallback = "0",
                                 .min = 0,
                                 .max = 3600,
                                 .doc = "By so much."},
                                {.key = "duration_s",
                                 .kind = FieldKind::number,
                                 .unit = "s",
                                 .fallback = "10",
                                 .min = 0.01,
                                 .max = 3600,
                                 .doc = "Length."}}};
  return section;
}

const Section& force() {
  static const Section section{
      "Force",
      "A force that is controlled.",
      {name("arm", "Which arm exerts it."),
       {.key = "direction",
        .kind = FieldKind::numbers,
        .required = true,
        .min = -1,
        .max = 1,
        .count = 3,
        .doc = "Unit vector in the world along which the arm pushes."},
       name("instance", "Controllet whose outputs count."),
       {.key = "desired", .fallback = "force_desired_n", .doc = "Its output with the desired force."},
       {.key = "desired_n",
        .kind = FieldKind::number,
        .unit = "N",
        .doc = "What is desired where the controllet has no such output."}}};
  return section;
}

const Section& path() {
  static const Section section{"Path",
                               "A set-point that the end effector follows.",
                               {name("arm", "Which arm."),
                                name("instance", "Controllet that has the set-point."),
                                {.key = "input", .fallback = "pose", .doc = "Its input."},
                                {.key = "plane",
                                 .kind = FieldKind::choice,
                                 .fallback = "xyz",
                                 .choices = {"xy", "xyz"},
                                 .doc = "Which part of the error counts."}}};
  return section;
}

const Section& object() {
  static const Section section{"Grasp",
                               "An object that arms hold.",
                               {name("name", "The object."),
                                name("instance", "Controllet whose set-point the object follows."),
                                {.key = "input", .fallback = "pose", .doc = "Its input."}}};
  return section;
}

const Section& loss() {
  static const Section section{
      "Loss",
      "A surface that is taken away.",
      {name("arm", "Which arm loses it."),
       {.key = "at_s", .kind = FieldKind::number, .unit = "s", .required = true, .min = 0, .doc = "When."},
       {.key = "direction",
        .kind = FieldKind::numbers,
        .required = true,
        .min = -1,
        .max = 1,
        .count = 3,
        .doc = "Unit vector in the world along which the arm pushed."}}};
  return section;
}

const Section& measure() {
  static const Section section{"Measure",
                               "What is measured beyond the figures of every run.",
                               {part("window", window(), "The time that counts."),
                                list("force", force(), "Forces that are controlled."),
                                part("path", path(), "A set-point that is followed."),
                                part("grasp", object(), "An object that is held."),
                                part("loss", loss(), "A surface that is taken away.")}};
  return section;
}

const Section& experiment() {
  static const Section section{"Experiment",
                               "The top of the file.",
                               {{.key = "kind", .fallback = "task", .doc = "Which runner."},
                                text("title", "A line for people.", true),
                                text("description", "Some sentences for people."),
                                {.key = "seed",
                                 .kind = FieldKind::integer,
                                 .fallback = "1",
                                 .min = 0,
                                 .max = 1e9,
                                 .doc = "Of the variation and of the scene's noise."},
                                {.key = "repeats",
                                 .kind = FieldKind::integer,
                                 .fallback = "5",
                                 .min = 1,
                                 .max = 1000,
                                 .doc = "Of every variant on every plant."},
                                list("limits", limit(), "What is passed or failed."),
                                list("published", published(), "Figures of others."),
                                names("show", "Figures shown as bars although nothing limits them."),
                                text("scene", "Scene file, relative to this file."),
                                open("set", "Values put into the scene of every variant, by key path."),
                                names("plants", "Named sets of the plant's fidelity."),
                                list("variants", variant(), "Single variants."),
                                list("axes", axis(), "Choices to be combined."),
                                list("vary", variation(), "What differs from repeat to repeat."),
                                part("measure", measure(), "What is measured."),
                                open("settings", "What runners of other kinds read.")}};
  return section;
}

}  // namespace multipanda::experiment_schema

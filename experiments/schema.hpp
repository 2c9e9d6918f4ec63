#pragma once

#include "scene/fields.hpp"

// Every key of an experiment file, as tables.
namespace multipanda::experiment_schema {

const Section& experiment();
const Section& variant();  // of `variants`, and of an axis' `choices`
const Section& axis();
const Section& variation();
const Section& limit();
const Section& published();
const Section& measure();
const Section& window();
const Section& force();
const Section& path();
const Section& object();
const Section& loss();

}  // namespace multipanda::experiment_schema

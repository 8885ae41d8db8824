#pragma once

#include <functional>

namespace porttape {

// Asked every kRecordsBetweenLooks records by what reads far on a tape; true ends the reading.
using GiveUp = std::function<bool()>;
constexpr unsigned kRecordsBetweenLooks = 4096;

}  // namespace porttape

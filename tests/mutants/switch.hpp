// The switch between the mutants of one build; see README.md. Only a build of `tests/mutants/run` includes
// it.
#pragma once

#include <type_traits>

namespace porttape_mutants {

extern int active;  // the mutant that PORTTAPE_MUTANT names; 0: the unchanged program
extern unsigned char*
    reached;  // a byte for each mutant, in the file that PORTTAPE_MUTANT_REACHED names; nullptr without one

// Whether this process runs mutant `number`. Async-signal-safe.
[[gnu::always_inline]] inline bool on(int number) {
  if (reached != nullptr) [[unlikely]]
    reached[number] = 1;
  return number == active;
}

}  // namespace porttape_mutants

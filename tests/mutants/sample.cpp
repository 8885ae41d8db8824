// A source for mutants_test.py. Each function prints a line that depends on everything in it.
#include <cstdio>

namespace {

enum class Colour { red, green, blue };
constexpr int kLimit = 5;
constexpr int kSize = 3;  // used by the compiler alone

struct Log {
  void debug(const char*) { std::puts("debug"); }
} log;

int subtract(int a, int b) { return a - b; }

void left_out() {
  int value = 7;
  value += 20;
  std::printf("%d\n", value);
  log.debug("no mutant is here");
}

void break_left_out() {
  int rounds = 0;
  const int numbers[] = {5, 10, 20};
  for (int n : numbers) {
    rounds += n;
    if (n >= 10) break;
  }
  std::printf("%d\n", rounds);
  for (int n : numbers) std::printf("%d\n", n);
}

bool negated(int n) { return n == 3; }

void branch(int n) {
  if (n % 7 == 3 && n != 17)
    std::puts("taken");
  else
    std::puts("not taken");
}

struct Found {
  int value;
  explicit operator bool() const { return value % 2 != 0; }
};

void declared(int n) {
  if (const Found found = {n})
    std::printf("found %d\n", found.value);
  else
    std::puts("none");
}

void bound(int n) {
  int sum = 0;
  for (int i = 0; i < n; ++i) sum += i + 1;
  std::printf("%d\n", sum);
}

void constants(bool yes) {
  int sizes[kSize] = {};
  sizes[2] = 40;
  std::printf("%d %c %d\n", sizes[2] + kLimit, 'x', yes);
}

const char* name(Colour colour) {
  switch (colour) {
    case Colour::red:
      return "red";
    case Colour::green:
      return "green";
    default:
      break;
  }
  return "other";
}

void nested(int n) {
  const auto doubled = [](int a) { return a * 2; };
  std::printf("%d\n", subtract(subtract(doubled(n), 4), n));
}

constexpr int of_the_compiler(int n) { return n < 4 ? 1 : 2; }
static_assert(of_the_compiler(3) == 1);

}  // namespace

int main() {
  left_out();
  break_left_out();
  for (int n = 0; n < 20; ++n) {
    std::printf("%d\n", negated(n));
    branch(n);
    declared(n);
    bound(n);
  }
  constants(true);
  std::puts(name(Colour::green));
  std::puts(name(Colour::blue));
  nested(11);
}

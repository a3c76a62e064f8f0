#include "check.h"

#include <cstring>

namespace check {

namespace {
int failures = 0;
long checks = 0;
}  // namespace

std::vector<test_case> &all() {
  static std::vector<test_case> cases;
  return cases;
}

void failed(const char *file, int line, const std::string &what) {
  ++failures;
  std::cerr << file << ":" << line << ": " << what << "\n";
}

void counted() { ++checks; }

}  // namespace check

/// Arguments: words; a test runs when its name contains one of them, or all run without arguments.
int main(int count, char **words) {
  int run = 0;
  int bad = 0;
  for (const check::test_case &test : check::all()) {
    bool wanted = count == 1;
    for (int i = 1; i < count; ++i) wanted = wanted || std::strstr(test.name, words[i]) != nullptr;
    if (!wanted) continue;
    const int before = check::failures;
    test.run();
    ++run;
    if (check::failures != before) {
      ++bad;
      std::cerr << "FAILED " << test.name << "\n";
    }
  }
  std::cout << run << " tests, " << check::checks << " checks, " << bad << " tests failed\n";
  return bad == 0 && run > 0 ? 0 : 1;
}

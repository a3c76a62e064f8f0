// A small test harness: TEST registers a case, CHECK and CHECK_EQUAL record failures and go on.

#ifndef CHECK_H
#define CHECK_H

#include <iostream>
#include <random>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

namespace check {

struct test_case {
  const char *file;
  const char *name;
  void (*run)();
};

std::vector<test_case> &all();
void failed(const char *file, int line, const std::string &what);
void counted();

struct registrar {
  registrar(const char *file, const char *name, void (*run)()) { all().push_back({file, name, run}); }
};

/// A value as text; bytes as numbers, enumerations as their number.
template <class value>
std::string shown(const value &v) {
  std::ostringstream out;
  if constexpr (std::is_enum_v<value>) {
    out << static_cast<long long>(v);
  } else if constexpr (std::is_integral_v<value> && sizeof(value) == 1 && !std::is_same_v<value, bool>) {
    out << static_cast<int>(v);
  } else {
    out << v;
  }
  return out.str();
}

template <class left, class right>
void equal(const char *file, int line, const char *text, const left &a, const right &b) {
  counted();
  if (!(a == b)) failed(file, line, std::string(text) + ": " + shown(a) + " is not " + shown(b));
}

}  // namespace check

#define TEST(name)                                                               \
  static void test_##name();                                                     \
  static const check::registrar registered_##name(__FILE__, #name, test_##name); \
  static void test_##name()

#define CHECK(condition)                                             \
  do {                                                               \
    check::counted();                                                \
    if (!(condition)) check::failed(__FILE__, __LINE__, #condition); \
  } while (0)

#define CHECK_EQUAL(a, b) check::equal(__FILE__, __LINE__, #a " == " #b, (a), (b))

#endif

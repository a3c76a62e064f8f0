#include "sampling/smart_trigger.h"

void smart_trigger::start(uint16_t threshold) {
  threshold_ = threshold;
  deviation16_ = 0;
  rows_ = 0;
  above_ = 0;
}

bool smart_trigger::add(uint16_t reading) {
  if (rows_ == 0) mean64_ = static_cast<uint16_t>(reading << 6);
  const uint16_t mean = static_cast<uint16_t>((mean64_ + 32) >> 6);
  const bool up = reading > mean;
  uint16_t away = up ? reading - mean : mean - reading;
  if (away > 4 * threshold_)
    away = static_cast<uint16_t>(4 * threshold_);  // a blow of a few rows is no shake
  mean64_ = static_cast<uint16_t>(up ? mean64_ + away : mean64_ - away);
  deviation16_ = static_cast<uint16_t>(deviation16_ - (deviation16_ >> 4) + away);
  if (rows_ < settling) {
    ++rows_;
    return false;
  }
  if (deviation16_ >> 4 < threshold_) {
    above_ = 0;
    return false;
  }
  if (above_ < needed) ++above_;
  return above_ == needed;
}

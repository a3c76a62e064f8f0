#include "control/lamp.h"

bool lamp_lit(lamp pattern, moment since) {
  switch (pattern) {
    case lamp::off: return false;
    case lamp::on: return true;
    case lamp::slow_flash: return since % ms(1000) < ms(500);
    case lamp::fast_flash: return since % ms(200) < ms(100);
    case lamp::short_long: break;
  }
  const moment phase = since % ms(1500);  // 0.15 on, 0.15 off, 0.6 on, 0.6 off
  return phase < ms(150) || (phase >= ms(300) && phase < ms(900));
}

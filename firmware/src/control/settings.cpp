#include "control/settings.h"

#include "protocol/bytes.h"
#include "sampling/interval.h"
#include "sampling/sampler.h"

uint16_t settings::rate_now(uint8_t preset) const { return rate != 0 ? rate : preset_rate(preset); }

result read_settings(const frame &config, uint8_t preset, settings &s) {
  byte_reader in(config.payload, config.size);
  settings wanted;
  wanted.rate = in.u16();
  wanted.mode = in.u8();
  const uint8_t method = in.u8();
  wanted.readings = in.u8();
  wanted.pre = in.u16();
  wanted.threshold = in.u16();
  const bool power_of_two = wanted.readings != 0 && (wanted.readings & (wanted.readings - 1)) == 0;
  if (in.short_of_data() || wanted.mode > 1 || method > 2 || !power_of_two || wanted.readings > 32 ||
      wanted.pre > settings::most_pre || wanted.threshold == 0 || wanted.threshold > 511) {
    return result::bad_value;
  }
  if (wanted.rate != 0 && preset_number(wanted.rate) == preset_count) return result::bad_value;
  const interval every = interval_for(wanted.rate_now(preset));
  if (!sampler::fits(wanted.readings, every.cpu_cycles())) return result::bad_value;
  wanted.synch = static_cast<synch_method>(method);
  s = wanted;
  return result::done;
}

/* The SPI side of the nRF24L01: mode 0, most significant bit first (product specification 2.0,
 * chapter 7). Commands take effect as their bytes come; payloads when CSN rises. */
#include "radio.h"

#include <string.h>

enum {
    R_REGISTER = 0x00,
    W_REGISTER = 0x20,
    R_RX_PL_WID = 0x60,
    R_RX_PAYLOAD = 0x61,
    ACTIVATE = 0x50,
    ACTIVATE_KEY = 0x73,
    W_TX_PAYLOAD = 0xa0,
    W_ACK_PAYLOAD = 0xa8,
    W_TX_PAYLOAD_NO_ACK = 0xb0,
    FLUSH_TX = 0xe1,
    FLUSH_RX = 0xe2,
    REUSE_TX_PL = 0xe3,
};

#define REGISTER_MASK 0x1f
#define CLASS_MASK 0xe0
#define CARRIER_TIME 128e-6 /* s of carrier before CD says so */

static uint8_t *address_register(radio *r, int number)
{
    switch (number) {
    case NRF_RX_ADDR_P0:
        return r->address_0;
    case NRF_RX_ADDR_P1:
        return r->address_1;
    case NRF_TX_ADDR:
        return r->address_tx;
    default:
        return NULL;
    }
}

static uint8_t fifo_status(const radio *r)
{
    return (uint8_t)(r->reuse << 6 | (r->tx_count == RADIO_FIFO) << 5 | (r->tx_count == 0) << 4 |
                     (r->rx_count == RADIO_FIFO) << 1 | (r->rx_count == 0));
}

static bool carrier(const radio *r, double time)
{
    return r->state == RADIO_RECEIVING &&
           air_busy_since(r->air, r, r->registers[NRF_RF_CH]) + CARRIER_TIME <= time;
}

static uint8_t read_register(radio *r, int number, int index, double time)
{
    uint8_t *address = address_register(r, number);
    if (address)
        return index < 5 ? address[index] : 0;
    if (index)
        return 0;
    switch (number) {
    case NRF_STATUS:
        return radio_status(r);
    case NRF_CD:
        return carrier(r, time);
    case NRF_FIFO_STATUS:
        return fifo_status(r);
    case NRF_DYNPD:
    case NRF_FEATURE:
        return r->activated ? r->registers[number] : 0;
    default:
        return r->registers[number];
    }
}

static void write_register(radio *r, int number, int index, uint8_t value, double time)
{
    uint8_t *address = address_register(r, number);
    if (address) {
        if (index < 5)
            address[index] = value;
        return;
    }
    if (index)
        return;
    switch (number) {
    case NRF_CONFIG:
        r->registers[number] = value & 0x7f;
        radio_update_irq(r, time);
        radio_power_changed(r, time);
        break;
    case NRF_STATUS: /* flags are cleared by writing one */
        r->registers[number] &= (uint8_t)~(value & NRF_INTERRUPTS);
        radio_update_irq(r, time);
        radio_power_changed(r, time); /* MAX_RT cleared with CE high: goes on sending */
        break;
    case NRF_RF_CH:
        r->registers[number] = value & 0x7f;
        r->registers[NRF_OBSERVE_TX] &= 0x0f; /* the count of lost packets starts again */
        break;
    case NRF_OBSERVE_TX:
    case NRF_CD:
    case NRF_FIFO_STATUS:
        break; /* read only */
    case NRF_DYNPD:
    case NRF_FEATURE:
        if (r->activated)
            r->registers[number] = value;
        break;
    default:
        if (number < NRF_FIFO_STATUS)
            r->registers[number] = value;
    }
}

static bool is_ack_payload(uint8_t command)
{
    return (command & 0xf8) == W_ACK_PAYLOAD;
}

static bool writes_payload(const radio *r, uint8_t command)
{
    return command == W_TX_PAYLOAD ||
           (r->activated && (is_ack_payload(command) || command == W_TX_PAYLOAD_NO_ACK));
}

static void queue_payload(radio *r, double time)
{
    int length = r->bytes - 1;
    if (length < 1 || r->tx_count == RADIO_FIFO)
        return;
    if (r->command == W_TX_PAYLOAD && r->reuse)
        radio_flush_tx(r); /* a new payload ends the reuse of the old one */
    radio_payload *slot = &r->tx[r->tx_count++];
    *slot = (radio_payload){
        .length = (uint8_t)(length > RADIO_PAYLOAD ? RADIO_PAYLOAD : length),
        .pipe = is_ack_payload(r->command) ? r->command & 7 : 0,
        .no_ack = r->command == W_TX_PAYLOAD_NO_ACK && r->registers[NRF_FEATURE] & NRF_EN_DYN_ACK,
    };
    memcpy(slot->bytes, r->args, slot->length);
    radio_power_changed(r, time); /* CE may be high already */
}

static void drop_received(radio *r)
{
    if (!r->rx_count)
        return;
    r->rx_count--;
    memmove(r->rx, r->rx + 1, (size_t)r->rx_count * sizeof *r->rx);
}

/* First byte of a command; returns the byte to shift out next. */
static uint8_t begin(radio *r, uint8_t command, double time)
{
    r->command = command;
    if ((command & CLASS_MASK) == R_REGISTER)
        return read_register(r, command & REGISTER_MASK, 0, time);
    switch (command) {
    case R_RX_PAYLOAD:
        return r->rx_count ? r->rx[0].bytes[0] : 0;
    case R_RX_PL_WID:
        return r->activated && r->rx_count ? r->rx[0].length : 0;
    case FLUSH_TX:
        radio_flush_tx(r);
        break;
    case FLUSH_RX:
        r->rx_count = 0;
        break;
    case REUSE_TX_PL:
        r->reuse = true;
        break;
    default:
        break;
    }
    return 0;
}

/* A further byte, number `index` from zero; returns the byte to shift out next. */
static uint8_t proceed(radio *r, uint8_t byte, int index, double time)
{
    if ((r->command & CLASS_MASK) == R_REGISTER)
        return read_register(r, r->command & REGISTER_MASK, index + 1, time);
    if ((r->command & CLASS_MASK) == W_REGISTER)
        write_register(r, r->command & REGISTER_MASK, index, byte, time);
    else if (r->command == R_RX_PAYLOAD && r->rx_count && index + 1 < RADIO_PAYLOAD)
        return r->rx[0].bytes[index + 1];
    else if (r->command == ACTIVATE && byte == ACTIVATE_KEY && index == 0)
        r->activated = !r->activated;
    else if (writes_payload(r, r->command) && index < RADIO_PAYLOAD)
        r->args[index] = byte;
    return 0;
}

static void put_out(radio *r, double time)
{
    wire *miso = r->pins[RADIO_MISO].wire;
    wire_set(miso, r->pins[RADIO_MISO].device,
             r->csn ? WIRE_FREE : r->shift_out & 0x80 ? WIRE_HIGH : WIRE_LOW, time);
}

void radio_spi_select(radio *r, bool csn, double time)
{
    if (csn == r->csn)
        return;
    r->csn = csn;
    if (!csn) {
        r->bits = r->bytes = 0;
        r->shift_out = radio_status(r); /* comes out with every command byte */
    } else if (r->bytes > 0) {
        if (writes_payload(r, r->command))
            queue_payload(r, time);
        else if (r->command == R_RX_PAYLOAD && r->bytes > 1)
            drop_received(r); /* deleted once it has been read */
    }
    put_out(r, time);
}

void radio_spi_clock(radio *r, bool sck, double time)
{
    if (sck == r->sck)
        return;
    r->sck = sck;
    if (r->csn)
        return;
    if (sck) { /* sampled at the rising edge, moved on at the falling one */
        r->shift_in = (uint8_t)(r->shift_in << 1 | r->mosi);
        r->bits++;
        return;
    }
    r->shift_out = (uint8_t)(r->shift_out << 1);
    if (r->bits == 8) {
        r->bits = 0;
        r->total.spi_bytes++;
        r->shift_out = r->bytes == 0 ? begin(r, r->shift_in, time)
                                     : proceed(r, r->shift_in, r->bytes - 1, time);
        r->bytes++;
    }
    put_out(r, time);
}

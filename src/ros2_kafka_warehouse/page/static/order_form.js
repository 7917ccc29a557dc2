// The dialog for one order.

import { $, h, setText, toast } from './shared/dom.js';
import { post } from './shared/server.js';

export function setUpOrderForm(site) {
  const dialog = $('order-dialog');
  const lines = $('order-lines');
  const station = $('order-station');
  station.append(...Object.keys(site.stations).map((name) => h('option', {}, name)));
  const products = Object.values(site.products).sort((a, b) => a.name.localeCompare(b.name));

  const addLine = () => {
    const number = lines.children.length + 1;
    const product = h('select', { 'aria-label': `Product ${number}`, class: 'product' },
      ...products.map((each) => h('option', { value: each.name }, `${each.name}, ${each.weightKg ?? 1} kg`)));
    product.selectedIndex = Math.floor(Math.random() * products.length);
    const quantity = h('input', { type: 'number', min: 1, max: 1000, value: 1, 'aria-label': `Quantity ${number}`, class: 'quantity', required: true });
    const drop = h('button', { type: 'button', class: 'quiet', 'aria-label': 'Leave this product out' }, '×');
    const line = h('div', { class: 'line' }, quantity, product, drop);
    drop.addEventListener('click', () => { if (lines.children.length > 1) line.remove(); });
    lines.append(line);
    return product;
  };

  $('new-order').addEventListener('click', () => {
    setText($('order-error'), '');
    if (!lines.children.length) addLine();
    dialog.showModal();
    station.focus();
  });
  $('order-more').addEventListener('click', () => { if (lines.children.length < 20) addLine().focus(); });
  $('order-cancel').addEventListener('click', () => dialog.close());
  $('order-form').addEventListener('submit', async (event) => {
    event.preventDefault();
    const due = $('order-due').value;
    const order = {
      station: station.value,
      priority: Number($('order-priority').value),
      lines: [...lines.children].map((line) => ({
        product: line.querySelector('.product').value,
        quantity: Number(line.querySelector('.quantity').value),
      })),
      ...(due ? { dueInS: 60 * Number(due) } : {}),
    };
    const send = $('order-send');
    send.disabled = true;
    try {
      const { orderId } = await post('api/orders', order);
      dialog.close();
      lines.replaceChildren();
      toast(`Order ${orderId} was sent.`);
    } catch (error) {
      setText($('order-error'), error.message);
    } finally {
      send.disabled = false;
    }
  });
}
